"""Skills on disk: one NPZ file, no pickle, versioned, refused if anything in it is not understood."""

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._errors import JaxrmpError, SkillFileError
from .._files import atomic_write
from .._version import __version__
from ..leaves import Learned, NominalPotential
from ._configuration import configuration_from_dict, configuration_to_dict
from ._metric_network import CholeskyFactor
from ._skill import Skill

FORMAT, VERSION = "jaxrmp skill", 1
_HEADER = "header.json"
_POTENTIAL = ("points", "biases", "end_slope", "width", "sharpness")


def save_skill(skill: Skill, path: str | os.PathLike) -> Path:
    """Write a skill to `path` (conventionally `NAME.skill.npz`); the file appears whole or not at all."""
    factor = skill.learned.cholesky_of
    if not isinstance(factor, CholeskyFactor) or not isinstance(skill.learned.potential_of, NominalPotential):
        raise SkillFileError("only skills of a NominalPotential and a CholeskyFactor can be saved.")
    arrays = {f"potential/{name}": getattr(skill.learned.potential_of, name) for name in _POTENTIAL}
    arrays |= {f"metric/{layer}/{name}": a for layer, d in factor.weights.items() for name, a in d.items()}
    arrays |= {"metric/length_scale": factor.length_scale}
    arrays |= {"gains/speed": skill.learned.speed, "gains/damping_rate": skill.learned.damping_rate}
    arrays |= {name: getattr(skill, name) for name in ("offsets", "targets", "T_base_object")}
    arrays = {name: np.asarray(a) for name, a in arrays.items()}
    header = {
        "format": FORMAT,
        "version": VERSION,
        "jaxrmp": __version__,
        "frames": list(skill.frames),
        "subtasks": list(skill.subtasks),
        "robot_fingerprint": skill.robot_fingerprint,
        "source": skill.source,
        "network": {
            "dimension": factor.dimension,
            "hidden": list(factor.hidden),
            "activation": factor.activation,
            "offset": factor.offset,
        },
        "configuration": configuration_to_dict(skill.configuration),
        "arrays": {name: [str(a.dtype), list(a.shape)] for name, a in arrays.items()},
    }
    path = Path(path)
    with atomic_write(path) as file:
        np.savez(file, **{_HEADER: np.frombuffer(json.dumps(header).encode(), np.uint8)}, **arrays)
    return path


def load_skill(path: str | os.PathLike) -> Skill:
    """Read a skill back, bit for bit.

    **Raises** `SkillFileError` if the file is missing, truncated or damaged, no skill, of another version, or holds
    anything that this version does not know.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            content = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise SkillFileError(f"there is no skill file {str(path)!r}. `jaxrmp learn` writes one.") from error
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zipfile.LargeZipFile) as error:
        raise SkillFileError(
            f"{str(path)!r} is no skill file, or is damaged: {error}. Learn the skill again."
        ) from error
    try:
        header: dict[str, Any] = json.loads(content.pop(_HEADER).tobytes())
        kind = header["format"]
    except (KeyError, TypeError, ValueError) as error:
        raise SkillFileError(f"{str(path)!r} is an NPZ file but no skill: it has no readable header.") from error
    if kind != FORMAT or header.get("version") != VERSION:
        raise SkillFileError(
            f"{str(path)!r} is {kind!r} version {header.get('version')!r}; this jaxrmp ({__version__}) reads "
            f"{FORMAT!r} version {VERSION}. It was written by jaxrmp {header.get('jaxrmp', 'unknown')}: use that, or "
            "learn the skill again."
        )
    try:
        return _skill_from(header, content)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, JaxrmpError) as error:
        raise SkillFileError(f"skill file {str(path)!r} does not hold what its version should: {error}") from error


def _skill_from(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> Skill:
    known = {
        "format", "version", "jaxrmp", "frames", "subtasks", "robot_fingerprint", "source", "network", "configuration",
        "arrays",
    }  # fmt: skip
    if unknown := set(header) ^ known:
        raise SkillFileError(f"header entries missing or unknown: {sorted(unknown)}.")
    found = {name: [str(a.dtype), list(a.shape)] for name, a in arrays.items()}
    if found != header["arrays"]:
        told = header["arrays"]
        differing = {name for name in found.keys() | told.keys() if found.get(name) != told.get(name)}
        raise SkillFileError(f"arrays missing, unknown or of another shape: {sorted(differing)}.")
    left = {name: jnp.asarray(a) for name, a in arrays.items()}
    potential = NominalPotential(*(left.pop(f"potential/{name}") for name in _POTENTIAL))
    length_scale = left.pop("metric/length_scale")
    learned_names = ("gains/speed", "gains/damping_rate", "offsets", "targets", "T_base_object")
    speed, damping_rate, offsets, targets, T_base_object = (left.pop(name) for name in learned_names)
    weights: dict[str, dict[str, Any]] = {}
    for name in list(left):
        _, layer, parameter = name.split("/")
        weights.setdefault(layer, {})[parameter] = left.pop(name)
    network = header["network"]
    factor = CholeskyFactor(
        weights,
        length_scale,
        int(network["dimension"]),
        tuple(network["hidden"]),
        network["activation"],
        float(network["offset"]),
    )
    return Skill(
        learned=Learned(potential, factor, speed, damping_rate),
        offsets=offsets,
        targets=targets,
        T_base_object=T_base_object,
        frames=tuple(header["frames"]),
        subtasks=tuple(header["subtasks"]),
        configuration=configuration_from_dict(header["configuration"]),
        robot_fingerprint=header["robot_fingerprint"],
        source=header["source"],
    )
