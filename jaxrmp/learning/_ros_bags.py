"""Bags of ROS 1 and 2 (SQLite, MCAP), one demonstration each: joint states, and transforms of a tracked object."""

import contextlib
import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import DemonstrationError, JaxrmpError, importing
from ..kinematics import Robot
from ._demonstrations import Demonstration, DemonstrationSet, check_demonstration
from ._recording import RecordingSettings, choose_groups, chosen_episodes, in_natural_order, name_columns
from ._ros_transforms import Transforms, base_frame

JOINTS = "sensor_msgs/msg/JointState"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_USUAL = "/joint_states"
_LOOKED_AT = 200  # messages of a topic, for the names in them
_LATE = 1.0  # s, by which messages may come late; more is a clock that was set back
_STALE = 0.5  # s, from which on an old pose of an object, or a piece that is cut off, is worth a word
_MAGIC = (b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"SQLite format 3\x00")


def bags_at(path: Path) -> list[Path]:
    """The bags that `path` is, or that lie in it, in natural order; a folder with a metadata.yaml is one."""
    if _is_bag(path):
        return [path]
    return sorted(filter(_is_bag, path.iterdir()), key=in_natural_order) if path.is_dir() else []


def read_bags(
    path: Path, recording: RecordingSettings, robot: Robot | None, base: str, tracked: str, told: list[str]
) -> DemonstrationSet:
    """A demonstration a bag: positions of its joint states by name; of the frame `tracked`, if any, its pose in `base`.

    **Raises** `DemonstrationError`, naming the bag, for topics, joints or frames that are not there, and for clocks
    that were set back; `MissingDependencyError` without rosbags.
    """
    bags = bags_at(path)
    numbers = chosen_episodes(recording, range(len(bags)), path)
    names: tuple[str, ...] = ()
    said: dict[str, list[str]] = {}
    layout = ""
    found = []
    for bag in (bags[number] for number in numbers):
        with _opened(bag) as reader:
            own: list[str] = []
            layout = layout or _contents(reader)
            topics = _topics(reader, recording, robot, bag)
            stamps, recorded, q = _joint_states(reader, topics, robot, bag, own)
            names = names or recorded
            if set(recorded) != set(names):
                raise DemonstrationError(
                    f"{bag} has the joints {sorted(recorded)}, {bags[numbers[0]]} has {sorted(names)}."
                )
            poses = {}
            if tracked:
                poses[tracked] = _object_pose(reader, stamps, base, tracked, robot, bag, own)
        demonstration = Demonstration(
            (stamps - stamps[0]) * 1e-9, q[:, [recorded.index(name) for name in names]], poses
        )
        check_demonstration(demonstration, names, str(bag))
        found.append(demonstration)
        for what in own:
            said.setdefault(what, []).append(bag.name)
    for what, of in said.items():
        told.append(f"{', '.join(of) if len(of) < max(2, len(found)) else 'all bags'}: {what}")
    if recording.rate:
        told.append("recording.rate (--rate) is not used: the stamps of a bag's messages say the time.")
    units = recording.units or "rad"
    layout = f"{len(bags)} bags: {', '.join(topics)}{f' and the frame {tracked}' * bool(tracked)}; of {layout}"
    names = name_columns(["joints"], {"joints": names}, recording, robot, path, told)
    return DemonstrationSet(tuple(found), names, "unknown", path.name, units, layout)


def _is_bag(path: Path) -> bool:
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    try:
        with open(path, "rb") as file:
            return file.read(16).startswith(_MAGIC)
    except OSError:
        return False


@contextlib.contextmanager
def _opened(bag: Path) -> Iterator[Any]:
    """The reader of a bag; whatever it finds wrong with the bytes names the bag."""
    with importing("rosbags", "formats"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.LATEST)) as reader:
            yield reader
    except JaxrmpError:
        raise
    except Exception as error:
        raise DemonstrationError(f"{bag} is not readable as a bag: {type(error).__name__}: {error}") from error


def _contents(reader: Any) -> str:
    """What could have been read: topics of joint states, and the frames of the first transforms."""
    some = [message for _, message in itertools.islice(_transforms(reader), _LOOKED_AT)]
    frames = dict.fromkeys(frame.lstrip("/") for m in some for frame in (m.header.frame_id, m.child_frame_id))
    topics = [topic for topic, info in reader.topics.items() if info.msgtype == JOINTS]
    return f"topics {', '.join(topics)}; frames {', '.join(frames) or 'none'}"


def _topics(reader: Any, recording: RecordingSettings, robot: Robot | None, bag: Path) -> list[str]:
    """The topics of joint states that are to be read."""
    groups = {topic: () for topic, info in reader.topics.items() if info.msgtype == JOINTS and info.msgcount}
    if not groups:
        there = ", ".join(f"{topic} ({info.msgtype})" for topic, info in list(reader.topics.items())[:20])
        raise DemonstrationError(f"{bag} has no messages of {JOINTS}; it has {there or 'none at all'}.")
    for topic in groups:
        names: dict[str, None] = {}
        for count, (connection, _, raw) in enumerate(reader.messages(reader.topics[topic].connections)):
            if count == _LOOKED_AT:
                break
            names |= dict.fromkeys(reader.deserialize(raw, connection.msgtype).name)
        groups[topic] = tuple(names)
    return choose_groups(groups, recording, robot, _USUAL, bag)


def _joint_states(
    reader: Any, topics: Sequence[str], robot: Robot | None, bag: Path, told: list[str]
) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """Stamps [T], ns; joints' names; positions [T, n]: of joints that come in messages of their own interpolated."""
    known = set(robot.joint_names) if robot is not None else set()
    left_out: dict[str, None] = {}
    series: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for topic in topics:
        rows: dict[tuple[str, ...], tuple[list[int], list[np.ndarray]]] = {}
        stamps, empty = [], 0
        for connection, logged, raw in reader.messages(reader.topics[topic].connections):
            message = reader.deserialize(raw, connection.msgtype)
            names = tuple(message.name)
            if len(set(names)) < len(names):
                raise DemonstrationError(f"{bag}: message {len(stamps)} of {topic} names a joint twice: {list(names)}.")
            if len(message.position) != len(names):
                empty += 1
                continue
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            rows.setdefault(names, ([], []))[0].append(len(stamps))
            rows[names][1].append(message.position)
            stamps.append((stamp, logged))
        if empty:
            told.append(f"{empty} messages of {topic} without a position for each name are left out.")
        ticks = _ticks(np.array(stamps, np.int64).reshape(-1, 2), topic, bag, told)
        mine: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        there = set().union(*rows)
        wanted = known & there or there
        for names, (indices, positions) in rows.items():
            table = np.array(positions, np.float64)
            for j, name in enumerate(names):
                if name not in wanted:
                    left_out[name] = None
                    continue
                mine.setdefault(name, []).append((ticks[indices], table[:, j]))
        if twice := sorted(set(mine) & set(series)):
            raise DemonstrationError(
                f"{bag}: joint {twice[0]!r} is in two of the topics {list(topics)}: name one of them."
            )
        for name, pieces in mine.items():
            at, values = (np.concatenate(part) for part in zip(*pieces, strict=True))
            order = np.argsort(at, kind="stable")
            series[name] = at[order], values[order]
    if left_out:
        told.append(f"{list(left_out)} are no moving joints of the robot and left out.")
    if not series:
        raise DemonstrationError(f"{bag}: no message of {', '.join(topics)} has positions.")
    return _together(series, bag, told)


def _ticks(stamps: np.ndarray, topic: str, bag: Path, told: list[str]) -> np.ndarray:
    """When messages were made, ns: by their own stamps [M, 2, first column], or as logged if they have none."""
    made, logged = stamps.T
    if not made.any():
        told.append(f"messages of {topic} have no stamps of their own: the time of logging is taken.")
        return logged
    back = np.maximum.accumulate(made) - made
    if len(back) and (worst := back.max() * 1e-9) > _LATE:
        at = int(back.argmax())
        raise DemonstrationError(
            f"{bag}: the stamps of {topic} go back by {worst:.3g} s at message {at}, as of a clock that was set anew. "
            "Cut the bag there."
        )
    if back.any():
        told.append(f"{(back > 0).sum()} messages of {topic} come late, by up to {worst:.3g} s: put in order.")
    return made


def _together(
    series: dict[str, tuple[np.ndarray, np.ndarray]], bag: Path, told: list[str]
) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """All joints at the stamps of the one that has most, from where all have begun to where the first ends."""
    stamps = max((at for at, _ in series.values()), key=len)
    others = [name for name, (at, _) in series.items() if not np.array_equal(at, stamps)]
    if others:
        moving = [at for at, _ in series.values() if len(at) > 1]
        first, last = max((at[0] for at in moving), default=0), min((at[-1] for at in moving), default=0)
        kept = stamps[(stamps >= first) & (stamps <= last)]
        if len(kept) < 2:
            raise DemonstrationError(f"{bag}: there is no time at which all of {list(series)} were recorded.")
        cut = (stamps[-1] - stamps[0] - (kept[-1] - kept[0])) * 1e-9
        told.append(
            f"{others} come in messages of their own and are interpolated"
            + (f"; {cut:.3g} s in which not all were recorded are cut off." if cut > _STALE else ".")
        )
        stamps = kept
        start = kept[0]  # float64 holds nanoseconds of a day, not of an epoch
        series = {name: (kept, np.interp(kept - start, at - start, values)) for name, (at, values) in series.items()}
    return stamps, tuple(series), np.stack([values for _, values in series.values()], axis=1)


def _object_pose(
    reader: Any, stamps: np.ndarray, base: str, tracked: str, robot: Robot | None, bag: Path, told: list[str]
) -> np.ndarray:
    """The pose of the frame `tracked` in `base`, [T, 4, 4], or [4, 4] if only static transforms lead there."""
    transforms = Transforms(_transforms(reader), str(bag))
    base, T_base_root = base_frame(base, robot, transforms.frames)
    T, age = transforms.pose(base, tracked, stamps)
    if age > _STALE:
        told.append(f"the pose of {tracked!r} is up to {age:.2g} s away from the nearest that was recorded.")
    return T_base_root @ T


def _transforms(reader: Any) -> Iterable[tuple[bool, Any]]:
    """Whether it is static, and the message, of each transform."""
    connections = [c for c in reader.connections if c.msgtype in TRANSFORMS]
    if connections:  # none would mean all
        for connection, _, raw in reader.messages(connections):
            static = connection.topic.endswith("tf_static")
            for transform in reader.deserialize(raw, connection.msgtype).transforms:
                yield static, transform
