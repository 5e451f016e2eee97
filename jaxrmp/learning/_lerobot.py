"""LeRobot datasets, versions 2 and 3: tables of all episodes in Parquet files, with a meta/info.json."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import DemonstrationError, importing
from ..kinematics import Robot
from ._demonstrations import JOINT_UNITS, Demonstration, DemonstrationSet, check_demonstration
from ._recording import Open, RecordingSettings, choose_groups, chosen_episodes, in_natural_order, name_columns, stated

INFO = Path("meta") / "info.json"
_USUAL = "observation.state"


def read_lerobot(folder: Path, recording: RecordingSettings, robot: Robot | None, told: list[str]) -> DemonstrationSet:
    """The episodes of the dataset in `folder`, split by their `episode_index` alone; images are not touched.

    **Raises** `DemonstrationError`, naming the file; `MissingDependencyError` without pyarrow.
    """
    info = _read_info(folder / INFO)
    version, features = str(info.get("codebase_version", "")), info.get("features", {})
    if version[:2] not in ("v2", "v3"):
        raise DemonstrationError(
            f"{folder / INFO} is of LeRobotDataset {version or 'without version'}; versions 2 and 3 are read. Convert "
            "it with lerobot."
        )
    groups = {
        key: _names(f.get("names"), _size(f)) or _size(f) for key, f in features.items() if _may_be_joints(key, f)
    }
    chosen = choose_groups(groups, recording, robot, _USUAL, folder)
    names = name_columns(chosen, groups, recording, robot, folder, told)
    seen, (episode, frame, stamp, task, q) = _read_tables(
        folder, chosen, {c: _size(features[c]) for c in chosen}, recording
    )
    numbers = chosen_episodes(recording, seen, folder)
    if not numbers:
        raise DemonstrationError(f"{folder / 'data'} holds no episode: its tables have no rows.")
    if (total := info.get("total_episodes")) not in (None, len(seen)):
        told.append(f"{INFO} says {total} episodes, the data hold {len(seen)}.")
    rate = recording.rate or float(info.get("fps") or 0.0)
    order = np.lexsort((frame, episode))
    rows_of = dict(zip(numbers, np.split(order, np.searchsorted(episode[order], numbers[1:])), strict=True))
    demonstrations = []
    unfit: list[int] = []
    for number, rows in rows_of.items():
        time = stamp[rows]
        runs = np.isfinite(time).all() and (np.diff(time) >= 0).all() and time[-1] > time[0]
        if recording.rate or not runs:
            if not rate:
                raise DemonstrationError(f"{folder}, episode {number}: no time stamps, and no fps in {INFO}.")
            if not recording.rate and not np.isnan(time).all():
                unfit.append(number)
            time = np.arange(len(rows)) / rate
        demonstration = Demonstration(time - time[0], q[rows])
        check_demonstration(demonstration, names, f"{folder}, episode {number}")
        demonstrations.append(demonstration)
    if unfit:
        told.append(
            f"time stamps of episodes {_shortened(unfit)} run backwards, stand still or are not finite: {rate:g} "
            f"samples a second are taken, as {INFO} says. recording.rate says otherwise."
        )
    by_task: dict[int, list[int]] = {}
    for number in numbers:
        by_task.setdefault(int(task[rows_of[number][0]]), []).append(number)
    if len(by_task) > 1:
        listed = "; ".join(f"{t}: episodes {_shortened(of)}" for t, of in sorted(by_task.items()))
        told.append(
            f"there are {len(by_task)} tasks (task_index {listed}), and a skill is one: choose its episodes with "
            "recording.episodes."
        )
    said = f"joint values from {q.min():.4g} to {q.max():.4g}" if q.size else ""
    (units,) = stated(recording, folder, units=Open("", JOINT_UNITS, said))
    left_out = [key for key in features if key not in chosen and not key.endswith("index") and key != "timestamp"]
    return DemonstrationSet(
        tuple(demonstrations),
        names,
        str(info.get("robot_type") or "unknown"),
        folder.name,
        units,
        f"LeRobotDataset {version}, {rate:g} samples a second: {', '.join(chosen)}; left out: "
        f"{', '.join(left_out) or 'nothing'}",
    )


def _read_info(file: Path) -> dict[str, Any]:
    try:
        info = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DemonstrationError(f"{file} is not readable as JSON: {error}.") from error
    if not isinstance(info, dict) or not isinstance(info.get("features"), dict):
        raise DemonstrationError(f"{file} has no 'features': it is no LeRobotDataset of version 2 or 3.")
    return info


def _may_be_joints(key: str, feature: Mapping[str, Any]) -> bool:
    return (
        key.startswith("observation")
        and str(feature.get("dtype")) in ("float16", "float32", "float64")
        and len(feature.get("shape") or ()) == 1
    )


def _shortened(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[:10])) + (f", ... ({len(numbers)})" if len(numbers) > 10 else "")


def _size(feature: Mapping[str, Any]) -> int:
    return int((feature.get("shape") or (0,))[0])


def _names(names: Any, size: int) -> tuple[str, ...] | None:
    """The names of a feature's columns: a list, or lists in dictionaries; None if they do not name each column."""

    def flat(entry: Any) -> list[str]:
        if isinstance(entry, Mapping):
            if entry and all(isinstance(v, int) for v in entry.values()):  # name: column
                return sorted(map(str, entry), key=lambda name: entry[name])
            return [name for value in entry.values() for name in flat(value)]
        return [name for value in entry for name in flat(value)] if isinstance(entry, list) else [str(entry)]

    found = tuple(name.removesuffix(".pos") for name in flat(names or []))
    return found if len(found) == size == len(set(found)) else None


def _read_tables(
    folder: Path, chosen: list[str], sizes: Mapping[str, int], recording: RecordingSettings
) -> tuple[list[int], tuple[np.ndarray, ...]]:
    """The episodes that there are; and of the rows of those wanted episode, frame, time stamp, task and `chosen`."""
    with importing("pyarrow", "formats"):
        import pyarrow as pa
        import pyarrow.parquet as pq
    files = sorted((folder / "data").rglob("*.parquet"), key=in_natural_order)
    if not files:
        raise DemonstrationError(
            f"{folder / 'data'} holds no .parquet files: download the dataset's data folder as well."
        )
    seen: set[int] = set()
    parts = [(*np.zeros((4, 0)), np.zeros((0, sum(sizes.values()))))]
    for file in files:
        try:
            with pq.ParquetFile(file, memory_map=True) as table:
                there = table.schema_arrow.names
                if absent := [key for key in ("episode_index", *chosen) if key not in there]:
                    raise DemonstrationError(f"{file} has no column {absent[0]!r}; it has {there}.")
                episode = _column(table.read(["episode_index"]), "episode_index", 1, file)[:, 0]
                seen.update(map(int, np.unique(episode)))
                wanted = np.isin(episode, recording.episodes) if recording.episodes else np.ones(len(episode), bool)
                if not wanted.any():
                    continue
                some = [key for key in ("frame_index", "timestamp", "task_index") if key in there]
                rows = table.read([*some, *chosen])
        except (pa.ArrowException, OSError) as error:
            raise DemonstrationError(f"{file} is not readable as Parquet: {error}.") from error
        column = {key: _column(rows, key, sizes.get(key, 1), file) for key in rows.column_names}
        frame = column.get("frame_index", np.arange(len(episode))[:, None])[:, 0]
        stamp = column.get("timestamp", np.full((len(episode), 1), np.nan))[:, 0]
        task = column.get("task_index", np.zeros((len(episode), 1)))[:, 0]
        q = np.concatenate([column[key] for key in chosen], axis=1)
        parts.append(tuple(a[wanted] for a in (episode, frame, stamp, task, q)))
    return sorted(seen), tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def _column(table: Any, key: str, size: int, file: Path) -> np.ndarray:
    """A column of numbers, or of lists of `size` numbers, as [rows, size]."""
    import pyarrow as pa

    values = table.column(key).combine_chunks()
    values = pa.concat_arrays(values.chunks) if isinstance(values, pa.ChunkedArray) else values
    if pa.types.is_list(values.type) or pa.types.is_large_list(values.type) or pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    numbers = values.to_numpy(zero_copy_only=False).astype(np.float64)
    if len(numbers) != table.num_rows * size:
        raise DemonstrationError(
            f"{file}: {key!r} holds {len(numbers)} numbers in {table.num_rows} rows, expected {size} in each: the "
            f"shape in {INFO} is another, or rows are empty."
        )
    return numbers.reshape(-1, size)
