"""Physics with the policy in the loop, steps a second against the number of starts: native MuJoCo, and MJX."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp.evaluation import scene_problem
from jaxrmp.kinematics._mujoco import import_mujoco
from jaxrmp.learning import load_skill
from jaxrmp.scenes import scene
from jaxrmp.simulation import MjxEngine, MujocoEngine, StopCriteria, mjx_compiler_options
from jaxrmp.xla import own_cores

from ._children import in_child
from ._plots import curves
from ._policies import POSTURE
from ._skills import skill_file
from ._timing import alternately

BATCHES, CHUNK, STAGE_BATCH = (1, 64, 1024), 50, 64


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row an engine and batch: steps of a millisecond a second, of all starts together, in the drawer's scene.

    The policy is the learned drawer skill. `mujoco` is the engine that `jaxrmp evaluate` uses, a compiled call of the
    policy a millisecond; `mujoco.rollout` steps on all cores with no policy. MJX runs in a
    child process. The rows of `stage` say what MJX's time goes into, each up to and without the one before.
    """
    batches = (4,) if quick else BATCHES
    mjx = in_child("benchmarks.rollouts:mjx_rows", list(batches), quick)
    return [*native_rows(batches, quick), *mjx]


def figure(found: list[dict[str, Any]]) -> Any:
    """Steps a second against the batch."""
    series: dict[str, tuple[list, list]] = {}
    for row in found:
        if row.get("steps_per_s"):
            at, values = series.setdefault(row["name"], ([], []))
            at.append(row["batch"])
            values.append(row["steps_per_s"])
    return curves(series, "starts", "steps a second")


def native_rows(batches: tuple[int, ...], quick: bool) -> list[dict[str, Any]]:
    """Native MuJoCo with the policy, and its own threaded rollout without."""
    from mujoco import rollout

    place, problem = _setting(quick)
    engine = MujocoEngine(place, problem, StopCriteria(), chunk=CHUNK, every=10)
    found = [_row("mujoco", engine, B) for B in batches]
    cores = own_cores()
    for B in batches:
        model, data = place.model, [place.fresh() for _ in range(cores)]
        first = np.asarray(engine.begin(_starts(B)).full)
        kind = {"nstep": CHUNK, "initial_state": _physics_state(place, first, B)}
        with rollout.Rollout(nthread=cores) as run:
            seconds = _seconds(lambda: run.rollout(model, data, **kind))  # noqa: B023
        found.append({"name": "mujoco.rollout, no policy", "batch": B, "steps_per_s": B * CHUNK / seconds})
    return found


def mjx_rows(batches: list[int], quick: bool) -> list[dict[str, Any]]:
    """MJX with the policy, and where its time goes."""
    place, problem = _setting(quick)
    engine = MjxEngine(place, problem, StopCriteria(), chunk=CHUNK, every=10)
    found = [] if quick else [_row("mjx", engine, B) for B in batches]  # compiling a whole chunk takes a minute
    return [*found, *stages(engine, problem, 4 if quick else STAGE_BATCH, quick)]


def stages(engine: MjxEngine, problem: Any, batch: int, quick: bool) -> list[dict[str, Any]]:
    """What each stage of a step adds, microseconds a step and start, in programs that end after it."""
    mjx, model, template = engine._mjx, engine._model, engine._template
    state = engine.begin(_starts(batch))

    def placed(state):
        return template.replace(qpos=state.qpos, qvel=state.qvel, qacc_warmstart=state.warm)

    steps: dict[str, Callable] = {
        "kinematics": lambda d: mjx.kinematics(model, d),
        "mass matrix": lambda d: mjx.factor_m(model, mjx.crb(model, mjx.com_pos(model, d))),
        "collision": lambda d: mjx.collision(model, d),
        "constraint": lambda d: mjx.make_constraint(model, d),
        "velocity": lambda d: mjx.fwd_velocity(model, mjx.transmission(model, d)),
        "acceleration": lambda d: mjx.fwd_acceleration(model, mjx.fwd_actuation(model, d)),
        "solve": lambda d: mjx.solve(model, d),
        "integrate": lambda d: mjx.implicit(model, d),
    }
    programs: dict[str, Callable] = {}
    for name in list(steps)[: 1 if quick else None]:
        until = list(steps)[: list(steps).index(name) + 1]

        def run(state, until=until):
            data = placed(state)
            for stage in until:
                data = steps[stage](data)
            return data

        programs[name] = jax.jit(jax.vmap(run), compiler_options=mjx_compiler_options())
    if not quick:
        whole = jax.vmap(lambda s: engine._step(problem, s))
        programs["policy, judge and all"] = jax.jit(whole, compiler_options=mjx_compiler_options())
    device_state = jax.tree.map(jnp.asarray, state)
    calls = {n: (lambda f=f: jax.block_until_ready(f(device_state))) for n, f in programs.items()}
    taken = alternately(calls, rounds=2 if quick else 9, least=0.0 if quick else 0.1)
    found, before = [], 0.0
    for name, values in taken.items():
        until = float(np.median(values)) / batch
        found.append({"name": f"stage: {name}", "batch": batch, "us": until - before, "us_until_here": until})
        before = until
    return found


def _setting(quick: bool) -> tuple[Any, Any]:
    skill = load_skill(skill_file("drawer_closing", quick=quick, method="paper"))
    place = scene("drawer", T_world_object=np.asarray(skill.T_world_object, float))
    return place, scene_problem(skill, skill.load_robot(), place)


def _starts(batch: int) -> np.ndarray:
    return np.asarray(POSTURE) + 0.05 * np.random.default_rng(0).normal(size=(batch, 7))


def _row(name: str, engine: Any, batch: int) -> dict[str, Any]:
    state = engine.begin(_starts(batch))
    start = time.perf_counter()
    state = engine.advance(state)
    first = time.perf_counter() - start
    seconds = _seconds(lambda: engine.advance(state))
    running = int((np.asarray(state.track.status) == 0).sum())
    return {
        "name": name,
        "batch": batch,
        "running": running,
        "steps_per_s": running * CHUNK / seconds,
        "us": 1e6 * seconds / (batch * CHUNK),
        "first_call_s": first,
    }


def _seconds(call: Callable[[], Any], least: float = 1.0) -> float:
    """Median seconds of calls, three at least, for about a second."""
    call()
    taken: list[float] = []
    while len(taken) < 3 or sum(taken) < least:
        start = time.perf_counter()
        call()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def _physics_state(place: Any, full: np.ndarray, batch: int) -> np.ndarray:
    """Full physics states [B, m] of starts, as `mujoco.rollout` wants them, from the engine's."""
    mujoco = import_mujoco()
    kind, wanted = mujoco.mjtState.mjSTATE_INTEGRATION, mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.empty((batch, mujoco.mj_stateSize(place.model, wanted)))
    data = place.fresh()
    for row, state in zip(states, full, strict=True):
        mujoco.mj_setState(place.model, data, state, kind)
        mujoco.mj_getState(place.model, data, row, wanted)
    return states
