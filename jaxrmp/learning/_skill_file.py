"""Skills on disk: one NPZ file, no pickle, of a version, refused if anything in it is not understood."""

import json
import os
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._errors import JaxrmpError, SkillFileError, UnknownNameError
from .._files import atomic_write, read_npz
from .._task_map import check_rigid
from .._version import __version__
from ..kinematics import record_from_dict, record_to_dict
from ..leaves import CruisingAttractor, Damping, Funnel, JointLimit, Learned, NominalPotential
from ._configuration import ACTIVATIONS
from ._configuration_file import configuration_from_dict, configuration_to_dict
from ._flow import Couplings, Flow
from ._hand_flow import HandFlow
from ._metric_network import CholeskyFactor, cholesky_shapes
from ._skill import Skill
from ._skill_versions import VERSION, SkillContent, up_to_date
from ._support import Support
from ._turn_attractor import TurnAttractor

FORMAT = "jaxrmp skill"
_HEADER = "header.json"
_PLACES = ("offsets", "targets", "T_world_object", "R_object_hand")
_NAMES = ("frames", "subtasks", "limited")
_TEXTS = ("robot_fingerprint", "source")
_HAND, _FLOW = ("offsets", "targets", "hands", "moves"), ("back", "length", "origin")
_FLOW_LEAVES = {
    "attractor": (CruisingAttractor, {"name": "learned"}),
    "funnel": (Funnel, {}),
    "posture": (Funnel, {"name": "posture"}),
}
_NETWORK = ("dimension", "hidden", "activation", "offset")


def save_skill(skill: Skill, path: str | os.PathLike) -> Path:
    """Write `skill` to `path` (conventionally `NAME.skill.npz`); the file appears whole or not at all."""
    network, flow = None, None
    if skill.flow is not None:
        arrays, flow = _flow_arrays(skill.flow), {"turned": skill.flow.turned}
    else:
        arrays, network = _learned_arrays(skill.learned)
    arrays |= {name: getattr(skill, name) for name in _PLACES}
    arrays |= _parameters("joint_damping", skill.joint_damping) | _parameters("joint_limit", skill.joint_limit)
    arrays = {name: np.asarray(a) for name, a in arrays.items()}
    header = {
        "format": FORMAT,
        "version": VERSION,
        "jaxrmp": __version__,
        **{name: getattr(skill, name) for name in (*_NAMES, *_TEXTS)},
        "network": network,
        "flow": flow,
        "robot": None if skill.robot_record is None else record_to_dict(skill.robot_record),
        "configuration": configuration_to_dict(skill.configuration),
        "arrays": {name: [str(a.dtype), list(a.shape)] for name, a in arrays.items()},
    }
    path = Path(path)
    with atomic_write(path) as file:
        np.savez(file, **{_HEADER: np.frombuffer(json.dumps(header).encode(), np.uint8)}, **arrays)
    return path


def load_skill(path: str | os.PathLike) -> Skill:
    """Read the skill at `path` back, bit for bit; one of an earlier version as `up_to_date` brings it to this one.

    **Raises** `SkillFileError` if the file is missing, truncated or damaged, no skill, of a newer version, or holds
    anything that its version does not know.
    """
    path = Path(path)
    try:
        content = read_npz(path)
    except FileNotFoundError as error:
        raise SkillFileError(f"there is no skill file {str(path)!r}. `jaxrmp learn` writes one.") from error
    except (OSError, ValueError) as error:
        raise SkillFileError(
            f"{str(path)!r} is no skill file, or is damaged: {error}. Learn the skill again."
        ) from error
    try:
        header: dict[str, Any] = json.loads(content.pop(_HEADER).tobytes())
        kind = header["format"]
    except (KeyError, TypeError, ValueError) as error:
        raise SkillFileError(f"{str(path)!r} is an NPZ file but no skill: it has no readable header.") from error
    if kind != FORMAT:
        raise SkillFileError(f"{str(path)!r} is an NPZ file but no skill: it is {kind!r}.")
    try:
        found = {name: [str(a.dtype), list(a.shape)] for name, a in content.items()}
        _same("arrays (by name, type and shape)", found.items(), header["arrays"].items())
        return _skill_from(*up_to_date(SkillContent(header, content)))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, JaxrmpError) as error:
        raise SkillFileError(f"skill file {str(path)!r} cannot be read: {error}") from error


def _skill_from(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> Skill:
    others = ("format", "version", "jaxrmp", "network", "flow", "robot", "configuration", "arrays")
    _same("header entries", header, (*others, *_NAMES, *_TEXTS))
    configuration = configuration_from_dict(header["configuration"])
    left = {name: jnp.asarray(a) for name, a in arrays.items()}
    for name, a in arrays.items():
        if left[name].dtype != a.dtype:
            raise SkillFileError(
                f"array {name} is {a.dtype}; load it under jax.enable_x64(True) to keep it bit for bit."
            )
        if not np.isfinite(a).all():
            raise SkillFileError(f"array {name} holds non-finite numbers.")
    K = len(header["subtasks"])
    learned = _learned_from(header["network"], left, K) if header["flow"] is None else None
    flow = _flow_from(header["flow"], left) if header["flow"] is not None else None
    shapes = zip(_PLACES, ((K, 3), (K, 3), (4, 4), (3, 3)), strict=True)
    skill = Skill(
        learned=learned,
        flow=flow,
        joint_damping=_built(Damping, "joint_damping", left, name="joint_damping"),
        joint_limit=_built(JointLimit, "joint_limit", left) if header["limited"] else None,
        configuration=configuration,
        robot_record=None if header["robot"] is None else record_from_dict(header["robot"]),
        **{name: _taken(left, name, shape) for name, shape in shapes},
        **{name: tuple(header[name]) for name in _NAMES},
        **{name: header[name] for name in _TEXTS},
    )
    _same("arrays", left, set())
    check_rigid(skill.T_world_object, "T_world_object")
    if len(skill.frames) != K:
        raise SkillFileError(f"{len(skill.frames)} frames for {K} subtasks.")
    return skill


def _learned_arrays(learned: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """The arrays of the paper's leaves, and the structure of their network."""
    factor = learned.cholesky_of
    if not isinstance(factor, CholeskyFactor) or not isinstance(learned.potential_of, NominalPotential):
        raise SkillFileError("only skills of a NominalPotential and a CholeskyFactor can be saved.")
    arrays = _parameters("potential", learned.potential_of)
    arrays |= {f"metric/{layer}/{name}": a for layer, d in factor.weights.items() for name, a in d.items()}
    arrays |= {"metric/length_scale": factor.length_scale}
    arrays |= _parameters("support", factor.support)
    arrays |= {"gains/speed": learned.speed, "gains/damping_rate": learned.damping_rate}
    return arrays, {name: getattr(factor, name) for name in _NETWORK} | {"supported": factor.support is not None}


def _learned_from(network: dict[str, Any], left: dict[str, Any], K: int) -> Learned:
    _same("network entries", network, (*_NETWORK, "supported"))
    structure = {name: network[name] for name in _NETWORK} | {"hidden": tuple(network["hidden"])}
    UnknownNameError.check("activation", structure["activation"], ACTIVATIONS)
    weights = {
        layer: {name: _taken(left, f"metric/{layer}/{name}", (K, *shape)) for name, shape in parameters.items()}
        for layer, parameters in cholesky_shapes(structure["dimension"], structure["hidden"]).items()
    }
    support = _built(Support, "support", left) if network["supported"] else None
    factor = CholeskyFactor(weights, _taken(left, "metric/length_scale", (K,)), support, **structure)
    potential = _built(NominalPotential, "potential", left)
    if potential.points.shape[:1] != (K,):
        raise SkillFileError(f"{len(potential.points)} potentials for {K} subtasks.")
    return Learned(potential, factor, _taken(left, "gains/speed", (K,)), _taken(left, "gains/damping_rate", (K,)))


def _flow_arrays(motion: HandFlow) -> dict[str, Any]:
    """The arrays of a flow and of what goes with it."""
    flow, arrays = motion.flow, {f"flow/{name}": getattr(motion, name) for name in _HAND}
    arrays |= {f"flow/{name}": getattr(flow, name) for name in _FLOW} | _parameters("couplings", flow.couplings)
    for name in _FLOW_LEAVES:
        arrays |= _parameters(name, getattr(motion, name))
    return arrays


def _flow_from(structure: dict[str, Any], left: dict[str, Any]) -> HandFlow:
    _same("flow entries", structure, ("turned",))
    flow = Flow(_built(Couplings, "couplings", left), **{name: left.pop(f"flow/{name}") for name in _FLOW})
    kinds = _FLOW_LEAVES | ({"attractor": (TurnAttractor, {"name": "learned"})} if "attractor/top" in left else {})
    leaves = {
        name: _built(kind, name, left, **named) if f"{name}/weight" in left else None
        for name, (kind, named) in kinds.items()
    }
    motion = HandFlow(flow, **leaves, **{name: left.pop(f"flow/{name}") for name in _HAND}, **structure)
    m = flow.back.shape[-1]
    if (
        flow.couplings.rotation.shape[1:] != (m, m)
        or motion.offsets.shape != motion.targets.shape
        or m not in ((3,) if motion.of_turn else (motion.offsets.size, 6))
    ):
        raise SkillFileError(f"a flow of {m} coordinates for offsets of shape {motion.offsets.shape}.")
    return motion


def _parameters(prefix: str, value: Any) -> dict[str, Any]:
    """The parameters of a `pytree` by their names in the file; none of None."""
    return {f"{prefix}/{name}": getattr(value, name) for name in _names(value)} if value is not None else {}


def _built(kind: type, prefix: str, arrays: dict[str, Any], **structure: Any) -> Any:
    """A `pytree` of its parameters in the file; one that the file has not, being older, is as `kind` has it."""
    found = {name: arrays.pop(f"{prefix}/{name}") for name in _names(kind) if f"{prefix}/{name}" in arrays}
    return kind(**found, **structure)


def _names(of: Any) -> list[str]:
    return [f.name for f in fields(of) if not f.metadata.get("static")]


def _taken(arrays: dict[str, Any], name: str, shape: tuple[int, ...]) -> Any:
    array = arrays.pop(name)
    if array.shape != shape:
        raise SkillFileError(f"array {name} has shape {array.shape}, expected {shape}.")
    return array


def _same(what: str, found: Iterable, expected: Iterable) -> None:
    """Raise if two collections differ, naming what is missing from one or unknown to the other."""
    found, expected = ([*map(str, items)] for items in (found, expected))
    if differing := sorted(set(found) ^ set(expected)):
        raise SkillFileError(f"{what} missing or unknown: {', '.join(differing)}.")
