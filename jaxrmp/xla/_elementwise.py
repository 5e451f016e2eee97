"""Elementwise operations that this machinery does not know by name: told by their own rules, and said in known ones."""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
from jax import lax
from jax.extend.core import ClosedJaxpr, Primitive

_SIZES = (2, 3, 4, 5, 6, 7, 8)  # no two the same, so that no rule takes one axis for another
_MANY = 11


def is_elementwise(equation: Any) -> bool:
    """Whether an operation is one of each entry on its own, as its primitive's rule for batches has it.

    That is one that, whichever axis it is mapped over, is the same operation of larger arrays, and of scalars, too.
    """
    values = [v.aval for v in (*equation.invars, *equation.outvars)]
    if equation.primitive.multiple_results or equation.effects or not equation.invars:
        return False
    shape = values[-1].shape
    if any(a.shape not in ((), shape) for a in values) or len(shape) >= len(_SIZES):
        return False
    if not all(isinstance(a.dtype, np.dtype) and a.dtype.kind in "biuf" for a in values):
        return False
    try:
        parameters = tuple(sorted(equation.params.items()))
        operands = tuple((bool(a.shape), a.dtype) for a in values[:-1])
        return _as_mapped(equation.primitive, parameters, operands, len(shape), values[-1].dtype)
    except Exception:  # of a rule that we do not know: there may be none, or none for such shapes
        return False


@functools.lru_cache(maxsize=256)
def _as_mapped(
    primitive: Primitive, parameters: tuple, operands: tuple[tuple[bool, np.dtype], ...], axes: int, result: np.dtype
) -> bool:
    function = functools.partial(primitive.bind, **dict(parameters))
    for own in {0, axes}:
        has = [whole or not own for whole, _ in operands]  # scalars among arrays are the same for all
        if not any(has):
            return False
        for k in range(own + 1):
            shape = (*_SIZES[:k], _MANY, *_SIZES[k:own])
            given = [jax.ShapeDtypeStruct(shape if h else (), t) for h, (_, t) in zip(has, operands, strict=True)]
            mapped = jax.vmap(function, in_axes=tuple(k if h else None for h in has), out_axes=k)
            jaxpr = jax.make_jaxpr(mapped)(*given).jaxpr
            equation = jaxpr.eqns[0]
            aval: Any = jaxpr.outvars[0].aval
            if len(jaxpr.eqns) > 1 or equation.primitive is not primitive or equation.params != dict(parameters):
                return False
            if equation.invars != jaxpr.invars or equation.outvars != jaxpr.outvars:
                return False
            if aval.shape != shape or aval.dtype != result:
                return False
    return True


def in_known_operations(equation: Any) -> ClosedJaxpr | None:
    """What an elementwise operation is made of, as JAX lowers it, in operations that are known; None if it is not."""
    function = functools.partial(equation.primitive.bind, **equation.params)
    avals = [jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in equation.invars]
    shape, dtype = equation.outvars[0].aval.shape, equation.outvars[0].aval.dtype
    try:
        scalars = [jax.ShapeDtypeStruct((), a.dtype) for a in avals]
        lowered = jax.jit(function).trace(*scalars).lower(lowering_platforms=("cpu",))
        program: Any = lowered.compiler_ir("stablehlo")
        functions = {f.name.value: f for f in program.body.operations if f.operation.name == "func.func"}

        def spelled_out(*values):
            return _run(functions, "main", [lax.broadcast(v, shape[np.ndim(v) :]) for v in values])

        found = jax.make_jaxpr(spelled_out)(*avals)
    except Exception:  # an operation that is not in the table, and whatever the lowering of what we do not know raises
        return None
    return found if [(a.shape, a.dtype) for a in found.out_avals] == [(shape, dtype)] else None


def _run(functions: Mapping[str, Any], name: str, arguments: list[Any]) -> list[Any]:
    """A function of scalars in StableHLO, on arrays of one shape."""
    block = functions[name].regions[0].blocks[0]
    found: dict[Any, Any] = dict(zip(block.arguments, arguments, strict=True))
    for each in block.operations:
        operation = each.operation
        values = [found[x] for x in operation.operands]
        if operation.name == "func.return":
            return values
        if operation.name == "func.call":
            results = _run(functions, operation.attributes["callee"].value, values)
        else:
            results = [_one(operation, values, arguments[0].shape)]
        found.update(zip(operation.results, results, strict=True))
    raise KeyError("func.return")


def _one(operation: Any, values: list[Any], shape: tuple[int, ...]) -> Any:
    dialect, _, name = operation.name.partition(".")
    given = operation.attributes
    if name == "constant":
        number = given["value"].get_splat_value().value
        return lax.full(shape, number, _DTYPES[str(operation.results[0].type.element_type)])
    if name == "convert":
        return lax.convert_element_type(values[0], _DTYPES[str(operation.results[0].type.element_type)])
    if name == "compare":
        if "compare_type" in given and "TOTALORDER" in str(given["compare_type"]):
            raise KeyError("TOTALORDER")
        return _COMPARISONS[str(given["comparison_direction"]).rpartition(" ")[2].rstrip(">")](*values)
    return _KNOWN[dialect][name](*values)


_DTYPES = {"f32": np.float32, "f64": np.float64, "i32": np.int32, "i64": np.int64, "i1": np.bool_}
_COMPARISONS = {name: getattr(lax, name.lower()) for name in ("EQ", "NE", "LT", "LE", "GT", "GE")}
_SAME = "abs add atan2 cbrt ceil clamp floor is_finite log logistic rsqrt sign sqrt tan tanh"
_OF_CHLO = "acos acosh asin asinh atan atanh cosh erf sinh square tan"
_KNOWN: dict[str, dict[str, Callable]] = {
    "stablehlo": {
        **{name: getattr(lax, name) for name in _SAME.split()},
        **{"cosine": lax.cos, "divide": lax.div, "exponential": lax.exp, "exponential_minus_one": lax.expm1},
        **{"log_plus_one": lax.log1p, "maximum": lax.max, "minimum": lax.min, "multiply": lax.mul, "negate": lax.neg},
        **{"power": lax.pow, "remainder": lax.rem, "sine": lax.sin, "subtract": lax.sub},
        **{"and": lax.bitwise_and, "or": lax.bitwise_or, "xor": lax.bitwise_xor, "not": lax.bitwise_not},
        "round_nearest_afz": functools.partial(lax.round, rounding_method=lax.RoundingMethod.AWAY_FROM_ZERO),
        "round_nearest_even": functools.partial(lax.round, rounding_method=lax.RoundingMethod.TO_NEAREST_EVEN),
        "select": lax.select,
    },
    "chlo": {name: getattr(lax, name) for name in _OF_CHLO.split()},
}
