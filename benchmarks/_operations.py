"""Operations and bytes that one evaluation of the 24-pair policy needs, counted by hand.

One operation is an addition, multiplication, comparison or selection of two numbers. `special` are divisions, square
roots, sines, cosines, exponentials and the like, which take longer. Products with the zeros and ones of the Panda's
fixed transforms are not counted, nor is anything computed twice; symmetric matrices count once.
"""

JOINTS, PAIRS, OBSTACLES = 7, 24, 4
# How many joints move the points at panda_link3 to panda_link7 and the hand.
MOVED_BY = (3, 4, 5, 6, 7, 7)
_OFFSETS = 7  # numbers other than zero in the fixed translations between joints, the hand's included
_LEVERS = 6  # of the bodies' origins, those that are away from the one before

Count = tuple[str, int, int]


def counted() -> list[Count]:
    """Parts of an evaluation: their name, operations, and special operations."""
    points, columns = len(MOVED_BY), sum(MOVED_BY)
    n = JOINTS
    cross, dot = 9, 5
    triangle = sum(k * (k + 1) // 2 for k in MOVED_BY)
    return [
        # Two columns of each rotation turn by (c, s): 3 x 2 x (2 products, 1 sum); each offset: 3 products, 3 sums.
        ("poses of six frames", 18 * n + 6 * _OFFSETS, 2 * n),
        # omega += z qd and alpha += omega x z qd; v += omega x r, a += alpha x r + omega x (omega x r) along levers.
        ("velocities and Jdot qd", n * (6 + cross + 6) + _LEVERS * (cross + 3 + 3 * cross + 6), 0),
        # A column is z x (p - o).
        ("Jacobians of six points", columns * (3 + cross), 0),
        # p - c, its square, its length less two radii; the unit vector; xd = u v; and u a + (v v - xd^2) / length.
        ("distances, speeds, curvature", PAIRS * (3 + dot + 1 + 3 + dot + dot + 4) + points * dot, 2 * PAIRS),
        # Ramp and slope 6; expm1 and its slope 8; metric, its two slopes 12; wall and slope 8; f and M 12.
        ("24 avoidance leaves", PAIRS * (6 + 8 + 12 + 8 + 12), 3 * PAIRS),
        # f += u f_i: 6; M += m u u^T: 3 + 6 + 6, in the space of each point.
        ("pulled back to six points", PAIRS * (6 + 15), 0),
        # M J 15 a column; the triangle of J^T (M J) and J^T f: 5 and a sum each.
        ("pulled back to the joints", columns * (15 + 6) + triangle * 6, 0),
        # |z|^2, weight and well with slopes, 3 x 3 curvature terms.
        ("goal", 3 + dot + 20 + 30 + 3 * 7, 5),
        # A side: ramp 6, wall and slope 8, inertia 7; a joint: place in range 8, weight and slopes 30, f and M 12.
        ("joint limits and damping", n * (2 * 21 + 50), n * 7),
        # n^3 / 3 products and sums; two substitutions of n^2.
        ("Cholesky and solution", n**3 // 3 + 2 * n * n, 3 * n),
    ]


def bytes_needed() -> int:
    """Bytes in and out of one evaluation in a batch, float32: q, qd and qdd; the tree is shared."""
    return 4 * 3 * JOINTS
