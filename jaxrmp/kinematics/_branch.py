"""The part of a file that is the robot: one branch, and none of the objects that lie beside it."""

import fnmatch
import warnings
from collections.abc import Collection, Iterator
from typing import Any

from .._errors import FileWarning, RobotError, UnknownNameError


def name_parts(spec: Any, source: str) -> None:
    """Name bodies and joints that have no name by their place in the whole file, so that branches of it agree.

    **Raises** `RobotError` if such a name is taken.
    """
    bodies = list(_below(spec.worldbody))
    for kind, parts in (("body", bodies), ("joint", [joint for body in bodies for joint in body.joints])):
        taken = {part.name for part in parts}
        for i, part in enumerate(parts):
            if not part.name:
                if f"{kind}_{i}" in taken:
                    raise RobotError(
                        f"{source}: one {kind} is called '{kind}_{i}', and one without a name would be. Name it."
                    )
                part.name = f"{kind}_{i}"


def keep_branch(mujoco: Any, spec: Any, root: str | None, fixed: Collection[str], source: str) -> set[str]:
    """Delete from `spec` what is not the robot, and return the names of the joints that go.

    With `root`, the body that the robot begins with, all that is not above or below it goes; joints above it, unless
    `fixed` has them, stay where the file's reference posture has them. So does a free joint of the root. Without, an
    object goes that one free joint moves and no other. **Raises** `UnknownNameError`, and `RobotError` for a joint that
    stays, is not in `fixed`, and follows one that goes. Keyframes go too.
    """
    for key in list(spec.keys):  # a state of the whole file, which MuJoCo would compare with what is left at once
        spec.delete(key)
    if root is None:
        return _without_objects(mujoco, spec, source)
    body = spec.body(root)
    if body is None:
        raise UnknownNameError("body", root, [b.name for b in spec.bodies if b.name])
    gone, chain, coupled = set(), [body], _couplings(mujoco, spec)
    while chain[-1].name != "world":
        chain.append(chain[-1].parent)
    names = {b.name for b in chain}
    for above in chain:
        for joint in list(above.joints):
            kept = above.name == root or _locked(joint.name, fixed)
            if joint.type == mujoco.mjtJoint.mjJNT_FREE or not kept:
                _warn_if_beyond(mujoco, joint, source)
                gone.add(joint.name)
                spec.delete(joint)
        if above.name != root:
            for other in [b for b in above.bodies if b.name not in names]:
                gone |= {joint.name for b in _below(other) for joint in b.joints}
                spec.delete(other)
    for follower, leader in coupled:
        if leader in gone and follower not in gone and not _locked(follower, fixed):
            raise RobotError(
                f"{source}: joint {follower!r} follows {leader!r}, which is no part of what begins with the root. "
                f"Lock it: fixed={{{follower!r}: ...}}, or choose a root above both."
            )
    _without_couplings(mujoco, spec, gone)
    return gone


def _warn_if_beyond(mujoco: Any, joint: Any, source: str) -> None:
    """A joint that goes stays at its reference, which its limits may not allow."""
    lower, upper = joint.range
    if lower < upper and joint.limited != mujoco.mjtLimited.mjLIMITED_FALSE and not lower <= joint.ref <= upper:
        warnings.warn(
            f"{source}: joint {joint.name!r} above the root stays at {joint.ref:g}, outside of its limits from "
            f"{lower:g} to {upper:g}. Lock it elsewhere: fixed={{{joint.name!r}: ...}}.",
            FileWarning,
            stacklevel=5,
        )


def _without_objects(mujoco: Any, spec: Any, source: str) -> set[str]:
    objects = [
        body
        for body in spec.worldbody.bodies
        if [joint.type for b in _below(body) for joint in b.joints] == [mujoco.mjtJoint.mjJNT_FREE]
    ]
    others = [joint for body in spec.bodies for joint in body.joints if joint.type != mujoco.mjtJoint.mjJNT_FREE]
    if not objects or not others:
        return set()
    names = [body.name for body in objects]
    gone = {joint.name for body in objects for joint in body.joints}
    for body in objects:
        spec.delete(body)
    _without_couplings(mujoco, spec, gone)
    warnings.warn(
        f"{source}: {names} lie free beside the robot and are no part of it. What it is to avoid goes into its World.",
        FileWarning,
        stacklevel=5,
    )
    return gone


def _couplings(mujoco: Any, spec: Any) -> list[tuple[str, str]]:
    """Followers and leaders of the joints that follow others."""
    return [(e.name1, e.name2) for e in spec.equalities if e.type == mujoco.mjtEq.mjEQ_JOINT and e.active]


def _without_couplings(mujoco: Any, spec: Any, gone: set[str]) -> None:
    bodies = {body.name for body in spec.bodies}
    for equality in list(spec.equalities):
        joints = equality.type == mujoco.mjtEq.mjEQ_JOINT
        named = {name for name in (equality.name1, equality.name2) if name}
        if (joints and named & gone) or (equality.objtype == mujoco.mjtObj.mjOBJ_BODY and named - bodies):
            spec.delete(equality)


def _locked(name: str, fixed: Collection[str]) -> bool:
    return name in fixed or any(fnmatch.fnmatch(name, pattern) for pattern in fixed)


def _below(body: Any) -> Iterator[Any]:
    yield body
    for child in body.bodies:
        yield from _below(child)
