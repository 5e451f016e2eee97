"""Skill files of earlier versions, brought up to date one version after the other."""

from typing import Any, NamedTuple

import numpy as np

from .._errors import SkillFileError
from .._rotations import nearest_rotation

VERSION = 8


class SkillContent(NamedTuple):
    """What a skill file holds: its `header`, as JSON has it, and its `arrays` by name."""

    header: dict[str, Any]
    arrays: dict[str, np.ndarray]


def up_to_date(content: SkillContent) -> SkillContent:
    """The same skill as a file of version `VERSION` holds it.

    **Raises** `SkillFileError` for a version that this library does not know, and where a file lacks what is needed.
    """
    version = content.header.get("version")
    if type(version) is not int or not 1 <= version <= VERSION:
        raise SkillFileError(
            f"it is of version {version!r}; this jaxrmp reads versions 1 to {VERSION}. It was written by jaxrmp "
            f"{content.header.get('jaxrmp', 'unknown')}: use that or a newer one, or learn the skill again."
        )
    for migrate in _STEPS[version - 1 :]:
        content = migrate(content)
    return content


def _from_1_to_2(content: SkillContent) -> SkillContent:
    """Joint limits get the `frequency` of their barrier's inertia, which version 2 brought, at its default then."""
    header, arrays = content
    limited = {"joint_limit/frequency": np.float32(50.0)} if header["limited"] else {}
    return SkillContent(header, arrays | limited)


def _from_2_to_3(content: SkillContent) -> SkillContent:
    """Metrics say whether they have a support, which early files of version 2 do not; the hand gets its orientation.

    It follows from where the points of the first control point's frame go, if they are three or more and on no line.
    """
    header, arrays = content
    metric = {"reach": 0.0, "convergence": 1e6} | header["configuration"]["metric"]  # as before there were such
    header = header | {
        "configuration": header["configuration"] | {"metric": metric},
        "network": {"supported": False} | header["network"],
    }
    rows = [frame == header["frames"][0] for frame in header["frames"]]
    offsets, targets = (arrays[name][rows] - arrays[name][rows].mean(0) for name in ("offsets", "targets"))
    if np.linalg.matrix_rank(offsets, 1e-6) < 2:
        raise SkillFileError(
            "it is of version 2 or earlier and does not say how the hand is turned at the end, nor do its control "
            "points, of which fewer than three are off a line: learn the skill again."
        )
    R = nearest_rotation(targets.T @ offsets).astype(targets.dtype)
    return SkillContent(header, arrays | {"R_object_hand": R})


def _from_3_to_4(content: SkillContent) -> SkillContent:
    """The configuration has the gains of the joints' leaves by leaf, under the leaf's own names."""
    header, arrays = content
    policy = dict(header["configuration"]["policy"])
    for leaf in ("joint_damping", "joint_limit"):
        given = [key for key in policy if key.startswith(f"{leaf}_")]
        policy[leaf] = {key.removeprefix(f"{leaf}_"): policy.pop(key) for key in given}
    if "rate" in policy["joint_damping"]:
        policy["joint_damping"]["damping_rate"] = policy["joint_damping"].pop("rate")
    return SkillContent(header | {"configuration": header["configuration"] | {"policy": policy}}, arrays)


def _from_4_to_5(content: SkillContent) -> SkillContent:
    """A skill says by which method it was learned; before there was a flow, by the paper's."""
    header = content.header | {"flow": None, "configuration": {"method": "paper"} | content.header["configuration"]}
    return SkillContent(header, content.arrays)


def _from_5_to_6(content: SkillContent) -> SkillContent:
    """Funnels lead along their postures, too; an earlier one led to the nearest of them alone."""
    header, arrays = content
    if header["flow"] is None:
        return content
    added = {f"{leaf}/left": np.float32(0.0) for leaf in ("funnel", "posture") if f"{leaf}/postures" in arrays}
    softness = {name: np.float32(0.05) for name in arrays if name.endswith("/softness")}  # no longer of squares
    flow = {**header["configuration"].get("flow", {}), "lead": 0.0}
    return SkillContent(header | {"configuration": header["configuration"] | {"flow": flow}}, arrays | added | softness)


def _from_6_to_7(content: SkillContent) -> SkillContent:
    """Funnels say from where on they lead along their postures; an earlier one did from where it led towards them."""
    header, arrays = content
    onset = {name.replace("inner", "onset"): a for name, a in arrays.items() if name.endswith("/inner")}
    configuration = header["configuration"]
    if "flow" in configuration:
        flow = {"inner": 0.8, "outer": 2.0, "lead": 0.5} | configuration["flow"]
        configuration = configuration | {"flow": {**flow, "onset": flow["inner"]}}
    return SkillContent(header | {"configuration": configuration}, arrays | onset)


def _from_7_to_8(content: SkillContent) -> SkillContent:
    """Files hold the robot; an earlier one names it only."""
    return SkillContent({**content.header, "robot": None}, content.arrays)


_STEPS = (_from_1_to_2, _from_2_to_3, _from_3_to_4, _from_4_to_5, _from_5_to_6, _from_6_to_7, _from_7_to_8)
