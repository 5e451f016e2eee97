"""The facts of a URDF file by URDF's own rules: MuJoCo's reader drops, renames and reinterprets some of them."""

import math
import warnings
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Collection, Iterable
from typing import NamedTuple

from .._errors import FileWarning, RobotError, UnsafeFileWarning

_MOVING = ("revolute", "continuous", "prismatic")


class UrdfJoint(NamedTuple):
    """A joint that moves: `lower`, `upper`, rad or m, infinite for a continuous one; `velocity`, rad/s or m/s, None
    where the file gives none; `leader`, whom it mimics, or None; `half`, whether one bound alone is written; `soft`,
    whether a safety_controller has limits within these."""

    lower: float
    upper: float
    velocity: float | None
    leader: str | None
    half: bool = False
    soft: bool = False


class Urdf(NamedTuple):
    """A file's `joints` that move, by name, and its `root` element, every joint's limits written out in it and the
    mimics of `idle` joints, which are fixed, left out."""

    root: ElementTree.Element
    joints: dict[str, UrdfJoint]
    idle: list[str]

    def without(self, gone: Collection[str]) -> "Urdf":
        """The same without the joints `gone`, whose followers follow nobody."""
        stay = {name: joint for name, joint in self.joints.items() if name not in gone}
        return self._replace(
            joints={name: j._replace(leader=None) if j.leader in gone else j for name, j in stay.items()}
        )


def read_urdf(text: str, source: str) -> Urdf:
    """Read and check the text of a URDF file; `source` names it. **Raises** `RobotError` that names link or joint.

    Position limits are URDF's: `lower` and `upper` are 0 where they are absent, a continuous joint has none.
    """
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise RobotError(f"{source} is not well-formed XML: {error}") from error
    namespace = root.tag.rpartition("robot")[0]  # Drake's files have one
    for element in root.iter():
        element.tag = element.tag.removeprefix(namespace)
    joints = root.findall("joint")
    for element in (*joints, *root.findall("link")):
        if any("${" in value or "$(" in value for part in element.iter() for value in part.attrib.values()):
            raise RobotError(
                f"{source}: {element.tag} {element.get('name')!r} holds xacro's $ expressions, which must be expanded "
                "first. Run `xacro FILE > robot.urdf` and give robot.urdf."
            )
        if not element.get("name"):
            raise RobotError(f"{source}: a {element.tag} has no name. URDF names every link and joint.")
    _require_unique(root, source)
    _require_tree(root, joints, source)
    found, idle = {}, []
    for joint in joints:
        mimic = joint.find("mimic")
        if joint.get("type") != "fixed":
            found[joint.attrib["name"]] = _joint(joint, mimic, source)
        elif mimic is not None:
            idle.append(joint.attrib["name"])
            joint.remove(mimic)
    for name, facts in found.items():
        if facts.leader is not None and (facts.leader not in found or facts.leader == name):
            why = "itself" if facts.leader == name else f"{facts.leader!r}, which is no joint that moves"
            raise RobotError(f"{source}: joint {name!r} mimics {why}. Joints that move: {sorted(set(found) - {name})}.")
    return Urdf(root, found, idle)


def warn_of(urdf: Urdf, names: Iterable[str], source: str) -> None:
    """Warn of what is left out, and of limits of the joints `names` that are not given or look wrong."""
    joints = {name: urdf.joints[name] for name in names}
    fast = [name for name, j in joints.items() if j.velocity is None]
    still = [name for name, j in joints.items() if j.lower == j.upper]
    one_sided = [name for name, j in joints.items() if math.isfinite(j.lower) != math.isfinite(j.upper)]
    degrees = [name for name, j in joints.items() if 20.0 < max(-j.lower, j.upper) <= 720.0]
    for kind, found, text in (
        (FileWarning, urdf.idle, "are fixed, so their mimics are left out."),
        (
            UnsafeFileWarning,
            fast,
            "have a velocity limit that is absent or not positive, which is read as none. Write it into the file "
            "(limit velocity), or set the robot's velocity_limit.",
        ),
        (
            FileWarning,
            still,
            "cannot move: their limits are equal (in URDF an absent lower or upper limit is 0). Write the limits into "
            "the file, or make the joints fixed.",
        ),
        (
            FileWarning,
            [name for name, j in joints.items() if j.half and j.lower < j.upper],
            "have one limit alone written, and the other is 0, as URDF has it. Write both, if that is not meant.",
        ),
        (
            FileWarning,
            [name for name, j in joints.items() if j.soft],
            "have soft limits (safety_controller) within their limits, which are not read: a controller "
            "that keeps them may hold the arm before a policy does. Write them into the limits, or set the robot's.",
        ),
        (UnsafeFileWarning, one_sided, "have a limit on one side alone: policies hold joints with two limits."),
        (
            UnsafeFileWarning,
            degrees,
            "have limits of more than three turns, or 20 m. URDF's are in rad and m: are these degrees, or mm?",
        ),
    ):
        if found:
            warnings.warn(f"{source}: joints {found} {text}", kind, stacklevel=4)


def _require_unique(root: ElementTree.Element, source: str) -> None:
    for kind in ("link", "joint"):
        counts = Counter(element.attrib["name"] for element in root.findall(kind))
        twice = [name for name, count in counts.items() if count > 1]
        if twice:
            raise RobotError(
                f"{source}: the {kind} name {twice[0]!r} is there {counts[twice[0]]} times (all such: {twice}). Names "
                "must be unique: give each arm a prefix."
            )


def _require_tree(root: ElementTree.Element, joints: list[ElementTree.Element], source: str) -> None:
    """Every link but one hangs on one joint, and all hang together."""
    links = [link.attrib["name"] for link in root.findall("link")]
    if not links:
        raise RobotError(f"{source}: there is no link. URDF's robot holds links and joints.")
    joint_above: dict[str, tuple[str, str]] = {}
    for joint in joints:
        name, ends = joint.attrib["name"], {}
        for end in ("parent", "child"):
            element = joint.find(end)
            link = None if element is None else element.get("link")
            if link not in links:
                raise RobotError(
                    f"{source}: the {end} of joint {name!r} is {link!r}, which is no link. Links: {links}."
                )
            ends[end] = link
        if ends["child"] in joint_above:
            raise RobotError(
                f"{source}: link {ends['child']!r} is the child of two joints, {joint_above[ends['child']][0]!r} and "
                f"{name!r}. jaxrmp's robots are trees: cut the loop."
            )
        joint_above[ends["child"]] = name, ends["parent"]
    roots = [link for link in links if link not in joint_above]
    reached, size = set(roots), 0
    while size != len(reached):
        size = len(reached)
        reached |= {child for child, (_, parent) in joint_above.items() if parent in reached}
    if len(reached) < len(links):
        circle = [link for link in links if link not in reached]
        raise RobotError(f"{source}: links {circle} hang on each other in a circle. jaxrmp's robots are trees.")
    if len(roots) > 1:
        raise RobotError(
            f"{source}: links {roots} hang on no joint; URDF has one such link, the base. Join them by a fixed joint."
        )
    if "world" in joint_above:
        raise RobotError(f"{source}: link 'world' is moved by joint {joint_above['world'][0]!r}. Give it another name.")


def _joint(joint: ElementTree.Element, mimic: ElementTree.Element | None, source: str) -> UrdfJoint:
    name, kind, limit = joint.attrib["name"], joint.get("type"), joint.find("limit")
    if kind in ("floating", "planar"):
        raise RobotError(
            f"{source}: joint {name!r} is a {kind} joint; jaxrmp's robots have revolute, prismatic and fixed joints. "
            "Make it fixed, or replace it by revolute and prismatic joints."
        )
    if kind not in _MOVING:
        raise RobotError(
            f"{source}: joint {name!r} is of type {kind!r}. URDF's types that can be read: {_MOVING}, fixed."
        )
    if limit is None and kind != "continuous":
        raise RobotError(
            f"{source}: the {kind} joint {name!r} has no limit, which URDF requires. Write one, or make it continuous."
        )
    # A continuous joint without a limit says nothing of its velocity, as it may: it has no limit at all.
    velocity: float | None = math.inf
    lower, upper, half = -math.inf, math.inf, False
    if limit is not None:
        velocity = _number(limit, "velocity", name, source, "velocity limit")
        velocity = velocity if velocity > 0.0 else None
        if kind != "continuous":
            lower, upper = (_number(limit, end, name, source, f"{end} limit") for end in ("lower", "upper"))
            half = (limit.get("lower") is None) != (limit.get("upper") is None)
            if math.isnan(lower) or math.isnan(upper):
                raise RobotError(f"{source}: a limit of joint {name!r} is not a number: {lower:g} to {upper:g}.")
            if not lower <= upper or lower == math.inf or upper == -math.inf:
                raise RobotError(
                    f"{source}: joint {name!r} has a lower limit of {lower:g} and an upper one of {upper:g}. Swap them?"
                )
            limit.set("lower", repr(lower))
            limit.set("upper", repr(upper))
        else:
            joint.remove(limit)  # MuJoCo would hold the joint to its bounds
    if mimic is not None:
        for entry in ("multiplier", "offset"):
            if not math.isfinite(_number(mimic, entry, name, source, f"mimic {entry}")):
                raise RobotError(f"{source}: joint {name!r} has the mimic {entry} {mimic.get(entry)!r}.")
    leader = None if mimic is None else mimic.get("joint", "")
    return UrdfJoint(lower, upper, velocity, leader, half, _has_soft_limits(joint, lower, upper, source))


def _has_soft_limits(joint: ElementTree.Element, lower: float, upper: float, source: str) -> bool:
    soft = joint.find("safety_controller")
    if soft is None or math.isinf(lower):
        return False
    low, high = (
        _number(soft, f"soft_{end}_limit", joint.attrib["name"], source, f"soft {end} limit")
        for end in ("lower", "upper")
    )
    return low < high and (low > lower or high < upper)  # both are 0 where they are absent: no soft limits


def _number(element: ElementTree.Element, key: str, joint: str, source: str, what: str) -> float:
    given = element.get(key, "0")
    try:
        return float(given)
    except ValueError as error:
        raise RobotError(f"{source}: joint {joint!r} has {what} {given!r}, expected a number.") from error
