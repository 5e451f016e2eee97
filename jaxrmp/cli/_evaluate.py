"""`jaxrmp evaluate`: roll a skill out from thousands of starts and report how stable it is."""

import argparse
import contextlib
import glob
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .._counted import counted
from .._errors import ConfigurationError, RolloutError
from ._ending import end_with_parent
from ._engines import engine_of
from ._optional import can_draw
from ._output import made_by, progress_bar, tell, write_arrays, write_json
from ._processes import PARENT, spawn

_TELL = 5.0  # s between two lines of progress where there is no terminal


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    kept = arguments.json and arguments.json.with_suffix(".finished.npz")
    if arguments.replay is not None:
        if arguments.resume:
            raise ConfigurationError("--resume is for an evaluation of all starts, and --replay runs one of them.")
        kept = None  # what is kept of all starts stays as it is
    if arguments.resume and not kept:
        raise ConfigurationError("--resume needs --json FILE, beside which finished starts were kept.")
    if arguments.processes > 1 and arguments.process is None:
        _begin(arguments, kept, arguments.processes)
        with _kept_told(kept):
            spawn(arguments.processes, arguments.command_line)
        return
    if arguments.process is None:
        _begin(arguments, kept, 1)
    elif PARENT in os.environ:
        end_with_parent(int(os.environ[PARENT]))
    _prepare_jax(arguments)
    if arguments.process is not None and PARENT not in os.environ:  # by hand: what is kept where it runs is its own
        _begin(arguments, kept and _of_process(kept, arguments.process, arguments.processes), 1)
    import jax

    from ..evaluation import check_starts, evaluate, limit_leaf, replay, report, sample_starts, write_page
    from ..simulation import StopCriteria
    from ._sources import skill_and_robot

    skill, robot = skill_and_robot(arguments.skill, arguments.robot)
    criteria = StopCriteria(tolerance=arguments.tolerance, duration=arguments.duration)
    engine, problem = engine_of(arguments, skill, robot, criteria)
    limits = limit_leaf(skill, robot)
    count = arguments.starts if arguments.replay is None else max(arguments.replay + 1, 1)
    if arguments.replay is not None and arguments.replay < 0:
        raise ConfigurationError(f"--replay {arguments.replay}: expected the index of a start, 0 or more.")
    if arguments.start_file:
        try:
            given = np.load(arguments.start_file, allow_pickle=False)
        except (OSError, ValueError, EOFError) as error:
            raise ConfigurationError(
                f"--start-file {str(arguments.start_file)!r} is no NPY file of starts [N, n]: {error}"
            ) from error
        starts = check_starts(problem, given)
        if count > len(starts) and arguments.replay is not None:
            raise ConfigurationError(f"--replay {arguments.replay}: {arguments.start_file} has {len(starts)} starts.")
    elif arguments.around:
        starts = _around(arguments, problem, skill, robot, count)
    else:
        starts = sample_starts(problem, count, seed=arguments.seed, margin=arguments.margin)
    if arguments.replay is not None:
        found = replay(engine, problem, limits, starts[arguments.replay])
        print(_replayed(arguments, found))
        return
    began = time.perf_counter()
    alone = contextlib.nullcontext() if PARENT in os.environ else _kept_told(kept)
    with alone, progress_bar(arguments.quiet) as show:
        show(f"{len(starts)} rollouts ({engine.name})", 0.0)
        evaluation = evaluate(engine, problem, limits, starts, batch=arguments.batch, progress=_rate(show), keep=kept)
    if jax.process_index() != 0:
        return
    found = report(evaluation, skill, problem)
    found["settings"] = {
        "skill": str(arguments.skill),
        "learned_from": skill.source,
        "physics": engine.name,
        "scene": arguments.scene or "the arm alone",
        "leaves": [leaf.name for leaf in problem.tree.leaves()],
        "seed": arguments.seed,
        "starts_from": (arguments.start_file and str(arguments.start_file))
        or (f"within {arguments.around} rad of demonstrations" if arguments.around else "joint limits"),
        "start_margin_rad": arguments.margin,
        "dt_s": engine.dt,
        "batch": evaluation.batch,
        "processes": jax.process_count(),
        "devices": jax.device_count(),
        "seconds": round(time.perf_counter() - began, 1),
        **asdict(evaluation.criteria),
    }
    found["made_by"] = made_by("evaluate", skill.configuration, skill.source)["versions"]
    page = arguments.html or (arguments.json and arguments.json.with_suffix(".html"))
    if arguments.json:
        write_json(found, arguments.json)
    if arguments.save:
        _save_ends(evaluation, arguments.save)
    if page:
        from ..visualization import evaluation_figures, png

        title = f"{skill.configuration.name}: {len(starts)} starts, {engine.name}"
        figures = evaluation_figures(evaluation).items() if can_draw() else ()
        pictures = {name: (png(figure), caption) for name, (figure, caption) in figures}
        write_page(found, pictures, page, title=title)
    for file in _kept_files(kept):
        file.unlink(missing_ok=True)  # all is in the report
    print(summary(found))
    if arguments.strict and found["failing_starts"]:
        raise RolloutError(
            f"--strict: {found['failing_starts']} of {found['starts']} starts neither converged nor stopped at a joint "
            f"limit, {found['non_finite']} of them diverged. Replay one with --replay INDEX, for example "
            f"{found['failing'][0]['start']}."
        )


def summary(found: dict[str, Any]) -> str:
    """The report in a few lines."""
    times = found["time_to_converge_s"]
    took = f"median {times['median']:.1f} s, longest {times['max']:.1f} s" if times else "none"
    touched = found["starts_that_touched"]
    clearance = "not watched: nothing is known of the arm's shape"
    if touched is not None:
        least = found["min_clearance_m"]
        clearance = f"{least:.3f} m" if np.isfinite(least) else "not watched"
        clearance += f" ({counted(touched, 'start')} touched)"
    places = counted(len(found["spurious_rest_points"]), "point")
    lines = [
        f"starts                  {found['starts']}",
        f"converged               {100 * found['converged']:.2f} %  ({took})",
        f"stopped at joint limit  {100 * found['stopped_at_limit']:.2f} %",
        f"held by contact         {100 * found['held_by_contact']:.2f} %",
        f"spurious rest           {100 * found['spurious']:.2f} %  ({places})",
        f"unfinished              {100 * found['unfinished']:.2f} %",
        f"non-finite              {found['non_finite']}",
        f"energy increase         {found['max_energy_increase']:.1e} of V's range at most",
        f"smallest clearance      {clearance}",
        f"smallest limit margin   {found['min_limit_margin_rad']:.4f} rad",
    ]
    return "\n".join(lines)


def _begin(arguments: argparse.Namespace, kept: Path | None, processes: int) -> None:
    """Before anything is evaluated: go on from the finished starts of an evaluation that was cut short, or not.

    **Raises** `ConfigurationError` for --resume of what another number of processes kept.
    """
    files = _kept_files(kept)
    if not arguments.resume:
        for file in files:
            tell(f"{file} has the finished starts of an evaluation that was cut short; removed, as without --resume.")
            file.unlink(missing_ok=True)
        return
    if not files:
        tell(f"--resume: nothing is kept yet in {kept}, so all begins from the start.")
        return
    own = [_of_process(kept, i, processes) for i in range(processes)]
    if foreign := set(files) - set(own):
        raise ConfigurationError(
            f"--resume: {', '.join(sorted(map(str, foreign)))} is of another number of --processes: give the same one."
        )


@contextlib.contextmanager
def _kept_told(kept: Path | None) -> Iterator[None]:
    """Where what is done within is interrupted, say whether there is something to go on from."""
    try:
        yield
    except KeyboardInterrupt:
        if files := _kept_files(kept):
            tell(f"--resume goes on from {', '.join(map(str, files))}.")
        else:
            tell("nothing has ended that is kept" + (": --resume would begin anew." if kept else ", without --json."))
        raise


def _of_process(kept: Path, process: int, processes: int) -> Path:
    """The file of one of several processes, as `evaluate` names it."""
    return kept if processes == 1 else Path(f"{kept}.{process}")


def _kept_files(kept: Path | None) -> list[Path]:
    """The files of finished starts, of one process or of several."""
    if kept is None:
        return []
    numbered = (file for file in kept.parent.glob(f"{glob.escape(kept.name)}.*") if file.suffix[1:].isdigit())
    return [*([kept] if kept.exists() else []), *sorted(numbered)]


def _rate(
    show: Callable[[str, float], None], clock: Callable[[], float] = time.monotonic
) -> Callable[[int, int], None]:
    """Progress in words: how many have ended, how many a second, and how long the others may take. The rate counts from
    the first that end here on, before which programs are compiled.

    Without a terminal, where each new word is a line, a line every few seconds.
    """
    seen, told = [], [-np.inf]  # times and numbers, of those that were there already and of the first that end

    def progress(ended: int, own: int) -> None:
        now = clock()
        if len(seen) < 2 and (not seen or ended > seen[0][1]):
            seen.append((now, ended))
        if not sys.stderr.isatty() and now - told[0] < _TELL and ended < own:
            return
        told[0] = now
        since, before = seen[-1]
        rate = (ended - before) / max(now - since, 1e-9)
        left = f", {rate:.3g}/s, {_duration((own - ended) / rate)} left" if rate > 0 else ""
        show(f"{ended} of {own} ended{left}", ended / own)

    return progress


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    return f"{minutes} min {seconds:02} s" if minutes else f"{seconds} s"


def _prepare_jax(arguments: argparse.Namespace) -> None:
    """Devices and processes, before JAX is used for anything."""
    if arguments.devices is not None:
        if arguments.devices < 1:
            raise ConfigurationError(f"--devices {arguments.devices}: expected at least 1.")
        import jax

        try:
            jax.config.update("jax_num_cpu_devices", arguments.devices)
        except RuntimeError as error:
            raise ConfigurationError(f"--devices cannot be set once JAX is in use: {error}") from error
    if arguments.process is not None:
        from ..evaluation import join_processes

        if arguments.coordinator is None:
            raise ConfigurationError("--process needs --coordinator HOST:PORT, the same for all processes.")
        join_processes(arguments.coordinator, arguments.processes, arguments.process)


def _save_ends(evaluation: Any, path: Path) -> None:
    """Every start and where it ended, for a comparison of engines or for one's own analysis."""
    kept = (
        (evaluation, ("starts", "seconds", "energy_increase")),
        (evaluation.ends, ("kind", "points", "error")),
        (evaluation.outcomes, ("q", "qd")),
        (evaluation.outcomes.track, ("touched", "clearance")),
    )
    write_arrays({name: np.asarray(getattr(of, name)) for of, names in kept for name in names}, path)


def _around(arguments, problem, skill, robot, count):
    from ..evaluation import starts_around
    from ..learning import prepare
    from ._sources import demonstrations_of

    prepared = prepare(skill.configuration, robot, demonstrations_of(skill, arguments.demos, robot))
    firsts = np.stack([q[0] for q in prepared.joints.q])
    return starts_around(problem, firsts, count, spread=arguments.around, seed=arguments.seed, margin=arguments.margin)


def _replayed(arguments: argparse.Namespace, found: Any) -> str:
    from ..evaluation import KINDS
    from ..simulation import End

    evaluation = found.evaluation
    if arguments.save:
        write_arrays({name: getattr(found, name) for name in ("time", "q", "qd")}, arguments.save)
    clearance = evaluation.outcomes.track.clearance[0]
    result = {
        "start": arguments.replay,
        "end": KINDS[End(int(evaluation.ends.kind[0]))],
        "seconds": float(evaluation.seconds[0]),
        "error_m": float(evaluation.ends.error[0]),
        "energy_increase": float(evaluation.energy_increase[0]),
        "min_clearance_m": float(clearance) if np.isfinite(clearance) else None,  # None: nothing was watched
        "min_limit_margin_rad": float(evaluation.outcomes.track.margin[0]),
        "q_start": evaluation.starts[0].tolist(),
        "q_end": evaluation.outcomes.q[0].tolist(),
    }
    if arguments.json:
        write_json(result, arguments.json)
    failed = result["end"] not in ("converged", "stopped_at_limit")
    if arguments.strict and failed:
        raise RolloutError(f"--strict: start {arguments.replay} ended {result['end']} after {result['seconds']:.2f} s.")
    return "\n".join(f"{name:<22}{'not watched' if value is None else value}" for name, value in result.items())
