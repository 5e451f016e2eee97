"""Arithmetic on scalars, vectors and rotations in which numbers known beforehand cost nothing.

A scalar is a Python float, known while JAX traces, or an array; arrays of one shape work entry by entry. Products
with 0 and 1 and sums with 0 are left out of the compiled program, and what is known altogether is computed in
Python. Vectors are tuples of three scalars; rotations are tuples of nine, row by row.
"""

from typing import Any

Scalar = Any
Vector = tuple[Scalar, Scalar, Scalar]
Rotation = tuple[Scalar, ...]

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def mul(a: Scalar, b: Scalar) -> Scalar:
    """`a b`."""
    if isinstance(b, float):
        a, b = b, a
    if isinstance(a, float) and not isinstance(b, float):
        if a == 0.0:
            return 0.0
        if a == 1.0:
            return b
        if a == -1.0:
            return -b
    return a * b


def add(a: Scalar, b: Scalar) -> Scalar:
    """`a + b`."""
    if isinstance(b, float):
        a, b = b, a
    return b if isinstance(a, float) and a == 0.0 else a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    """`a - b`."""
    if isinstance(b, float) and b == 0.0:
        return a
    return -b if isinstance(a, float) and a == 0.0 else a - b


def add3(u: Vector, v: Vector) -> Vector:
    """`u + v`."""
    return add(u[0], v[0]), add(u[1], v[1]), add(u[2], v[2])


def sub3(u: Vector, v: Vector) -> Vector:
    """`u - v`."""
    return sub(u[0], v[0]), sub(u[1], v[1]), sub(u[2], v[2])


def scale(s: Scalar, v: Vector) -> Vector:
    """`s v`."""
    return mul(s, v[0]), mul(s, v[1]), mul(s, v[2])


def cross(u: Vector, v: Vector) -> Vector:
    """`u x v`."""
    return (
        sub(mul(u[1], v[2]), mul(u[2], v[1])),
        sub(mul(u[2], v[0]), mul(u[0], v[2])),
        sub(mul(u[0], v[1]), mul(u[1], v[0])),
    )


def rotate(R: Rotation, v: Vector) -> Vector:
    """`R v`."""
    x, y, z = (add(add(mul(R[i], v[0]), mul(R[i + 1], v[1])), mul(R[i + 2], v[2])) for i in (0, 3, 6))
    return x, y, z


def matmul(A: Rotation, B: Rotation) -> Rotation:
    """`A B`."""
    columns = [rotate(A, (B[j], B[j + 3], B[j + 6])) for j in range(3)]
    return tuple(columns[j][i] for i in range(3) for j in range(3))


def axis_rotation(axis: tuple[float, float, float], c: Scalar, s: Scalar) -> Rotation:
    """Rotation about a unit vector by the angle of cosine `c` and sine `s`: `a a^T + c (I - a a^T) + s [a]x`."""
    x, y, z = axis
    skew = (0.0, -z, y, z, 0.0, -x, -y, x, 0.0)
    outer = tuple(a * b for a in axis for b in axis)
    return tuple(add(add(outer[k], mul(IDENTITY[k] - outer[k], c)), mul(skew[k], s)) for k in range(9))
