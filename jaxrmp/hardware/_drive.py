"""The loop that drives an arm by a law, cycle by cycle, and brakes it when its watch says so."""

import contextlib
import enum
import gc
import os
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from .._errors import ArmError, ConfigurationError
from ..simulation import tracking_acceleration
from ..world import Spheres
from ._arm import INTERFACES, Arm, ArmState, Interface
from ._law import Law, Step
from ._log import Log
from ._sightings import Sighting, Sightings
from ._watch import DriveSettings, Watch

_STIFFNESS, _DAMPING = 400.0, 40.0  # 1/s^2, 1/s: how torques hold the arm at its reference; and, since light links have
_STIFFER = 10.0  # friction as others have, by the arm's own `holding`, and a stiffness of so much, 1/s, times that
_STOPPED = 1e-3  # rad/s, below which a braking arm is told to stand
_STANDING, _STANDS, _PATIENCE = 0.002, 0.2, 5.0  # rad, s, s: an arm is driven once it moved no more in so long
_WARM = 300  # calls before the arm moves
_AFTER = 2.0  # seconds that braking may take beyond a drive's duration


class DriveEnd(enum.Enum):
    """How a drive ended: the arm came to `RESTED`; its `TIME` was over; it was `INTERRUPTED` from outside; the watch
    `STOPPED` it; or the arm ended it, or could not be reached, `BY_ARM`."""

    RESTED = "rested"
    TIME = "time"
    INTERRUPTED = "interrupted"
    STOPPED = "stopped"
    BY_ARM = "by_arm"


class Drive(NamedTuple):
    """A drive as it went: its `end` and the `reason`, in words; its `log`; `late`, cycles that came after more than
    one and a half of the arm's periods; `state`, the last one that was read; `real_time`, whether it was scheduled
    so."""

    end: DriveEnd
    reason: str
    log: Log
    late: int
    state: ArmState
    real_time: bool = False


def drive(
    arm: Arm,
    law: Law,
    sightings: Sightings,
    settings: DriveSettings | None = None,
    *,
    start: Any = None,
    interface: Interface = "velocity",
    names: tuple[str, ...] = (),
    running: Callable[[], bool] = lambda: True,
    priority: int = 0,
) -> Drive:
    """Drive an `arm` by a `law` until it rests, or something stops it; then it stands still.

    What the policy asks for is integrated, within the arm's limits, to a reference, from which it goes on. Velocities
    are the reference's, and mend what the arm has drifted from it; torques hold the arm at it, with the arm's own
    model. When the watch says so, the time is over, `running` says no or something here fails, the arm is braked
    straight on, within its limits, and the motion ended as it stands.

    **Arguments**: `sightings`, where the object is; `settings`, by default `DriveSettings()`; `start` [n], where the
    arm must be to begin, None for anywhere; `names`, of joints, for messages; `priority`, 1 to 99 to be scheduled in
    real time (SCHED_FIFO) where the system lets us, which `Drive.real_time` says.
    **Returns** a `Drive`: what went wrong on the way is in it, and not raised, so that the log is kept.
    **Raises** before anything moves: `ConfigurationError` for an arm that is not near `start` or has not the
    `interface`, `ArmError` for one that cannot be read or started.
    """
    settings = settings or DriveSettings()
    if interface not in arm.interfaces or interface not in INTERFACES:
        raise ConfigurationError(f"{arm.name} has no interface {interface!r}: it has {', '.join(arm.interfaces)}.")
    names = names or tuple(f"joint {k + 1}" for k in range(arm.joints))
    state = _standing(arm)
    seen = sightings.newest()
    if len(seen.obstacles) > law.obstacles:
        raise ConfigurationError(
            f"{len(seen.obstacles)} obstacles are told, and the law has slots for {law.obstacles}: "
            "hardware.law(policy, arm, obstacles=N)."
        )
    check_start(state.q, start, settings.near, names)
    log = Log(arm.joints, round((settings.duration + _AFTER) / arm.period))
    watch = Watch(settings, arm.limits, names, not law.uncertified)
    obstacles = _Obstacles(law.obstacles)
    _warm_up(law, state, seen, obstacles, settings.speed)
    if not running():
        return Drive(DriveEnd.INTERRUPTED, "interrupted before it moved", log, 0, state)
    with _no_garbage(), _scheduled(priority) as real_time:
        found = _cycles(arm, law, sightings, settings, interface, running, log, watch, obstacles, state)
        return found._replace(real_time=real_time)


def _standing(arm: Arm) -> ArmState:
    """The arm's state once it stands still. **Raises** `ArmError` if it does not within a few seconds."""
    state = arm.read()
    began, first, since, stood = time.perf_counter(), state.time, state.time, state.q
    while not state.time - since >= _STANDS:
        if not (np.abs(state.q - stood) <= _STANDING).all():
            since, stood = state.time, state.q
        if max(time.perf_counter() - began, state.time - first) > _PATIENCE:
            moving = np.round(state.qd, 2).tolist()
            raise ArmError(f"{arm.name} does not stand still: its joints move at {moving}, per second.")
        state = arm.read()
    return state


def check_start(q: np.ndarray, start: Any, near: float, names: tuple[str, ...]) -> None:
    """**Raises** `ConfigurationError`, by the joints' `names`, unless those at `q` [n] are all within `near`, rad, of
    `start` [n], if any."""
    if start is None:
        return
    apart = np.abs(np.asarray(q, float) - np.asarray(start, float))
    if not (apart <= near).all():
        far = [f"{names[k]} by {apart[k]:.2f}" for k in np.flatnonzero(~(apart <= near))]
        raise ConfigurationError(
            f"the arm is not at the start: {', '.join(far)} rad away, and {near:g} is allowed. It is at "
            f"{np.round(q, 3).tolist()}, the start is {np.round(start, 3).tolist()}. Take it there first (--go "
            "moves it there, slowly), or state another start."
        )


def _cycles(
    arm: Arm,
    law: Law,
    sightings: Sightings,
    settings: DriveSettings,
    interface: str,
    running: Callable[[], bool],
    log: Log,
    watch: Watch,
    obstacles: "_Obstacles",
    state: ArmState,
) -> Drive:
    n, period, speed = arm.joints, arm.period, np.float32(settings.speed)
    qd = qdd = nothing = np.zeros(n, np.float32)
    drift, reference = qd, np.zeros(n)
    stopped = min(_STOPPED, 0.5 * period * float(np.min(arm.limits.acceleration)))
    hold = settings.hold / min(settings.speed, 1.0)
    end, reason, late, still, braked = None, "", 0, 0.0, 0
    began: float | None = None
    seen = sightings.newest()
    try:
        arm.start(interface)
        while True:
            last, state = state, arm.read()
            if began is None:
                began, dt, reference = state.time, period, state.q_d.astype(float)
            else:
                dt = state.time - last.time
                if dt > 1.5 * period:
                    late += 1
                    if interface == "velocity":  # the arm went on by itself
                        qd = state.qd_d - drift
                reference = reference + min(max(dt, 0.0), settings.late) * qd
            state = state._replace(q_d=reference.astype(np.float32))
            step = None
            if not reason:
                try:
                    seen = sightings.newest()
                    spheres = obstacles.of(seen)
                    step = law.step(seen.T_world_object, spheres, state.q_d, state.q, qd, qdd, drift, speed)
                    if reason := watch.look(state, dt, seen, step):
                        end = DriveEnd.STOPPED
                    elif not running():
                        end, reason = DriveEnd.INTERRUPTED, "interrupted"
                    elif state.time - began > settings.duration:
                        end, reason = DriveEnd.TIME, f"did not come to rest within {settings.duration:g} s"
                except KeyboardInterrupt:
                    end, reason = DriveEnd.INTERRUPTED, "interrupted"
                except Exception as error:  # whatever fails on our side, the arm is braked
                    end, reason = DriveEnd.STOPPED, f"{type(error).__name__}: {error}"
            if reason:
                braked += 1
                if braked * period > _AFTER:
                    raise ArmError(f"{arm.name} could not be braked within {_AFTER:g} s")
                step = _braking(law.brake(state.q_d, state.q, qd, qdd, drift), step)
            assert step is not None
            qd, qdd, drift = step.qd, step.qdd, step.drift
            slow = step.looked.fastest < settings.still * settings.speed and state.time - began > hold
            still = still + dt if slow else 0.0
            if not reason and still >= hold:
                end, reason = DriveEnd.RESTED, "came to rest"
            last_one = bool(reason) and bool(step.looked.sent < stopped)
            if interface == "torque":
                command = _torque(arm, state, qd, qdd)
            else:
                command = nothing if last_one else step.command
            if not np.isfinite(command).all():
                raise ArmError(f"{arm.name} was to be told what is no number: its state was not finite")
            try:
                arm.send(command, last_one)
            finally:
                log.add(state, dt, seen, step, command, bool(reason), time.perf_counter() - state.arrived)
            if last_one:
                assert end is not None
                return Drive(end, reason, log, late, state)
    except ArmError as error:
        with contextlib.suppress(ArmError):
            arm.stop()
        why = f"{reason}; then {error}" if reason else str(error)
        return Drive(DriveEnd.BY_ARM, why, log, late, state)
    except KeyboardInterrupt:
        with contextlib.suppress(ArmError):
            arm.stop()
        return Drive(DriveEnd.INTERRUPTED, "interrupted", log, late, state)
    except BaseException:
        with contextlib.suppress(ArmError):
            arm.stop()
        raise


def _braking(given: Step, asked: Step | None) -> Step:
    """The step of an arm that brakes: as `given`, and what the policy still said, if it was `asked`."""
    if asked is None:
        return given
    return given._replace(wanted=asked.wanted, energy=asked.energy, dissipation=asked.dissipation)


def _torque(arm: Arm, state: ArmState, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Torques [n] besides gravity's that hold the arm at its reference: `M (qdd + kp e + kd ed) + c + K e + D ed`."""
    M, bias = arm.dynamics()
    wanted = tracking_acceleration(qdd, state.q_d - state.q, qd - state.qd, _STIFFNESS, _DAMPING)
    held = arm.holding() * (_STIFFER * (state.q_d - state.q) + (qd - state.qd))
    return np.asarray(M @ wanted + bias + held)


class _Obstacles:
    """Sightings' spheres in a law's slots."""

    def __init__(self, slots: int):
        self._slots, self._spheres, self._number = slots, None, None

    def of(self, seen: Sighting) -> Any:
        """The slots as `seen` has them; made anew when there is news, and None where there are none."""
        if self._slots and seen.number != self._number:
            center, radius = np.zeros((self._slots, 3), np.float32), np.zeros(self._slots, np.float32)
            count, self._number = len(seen.obstacles), seen.number
            center[:count], radius[:count] = seen.obstacles[:, :3], seen.obstacles[:, 3]
            self._spheres = Spheres(center, radius, np.arange(self._slots) < count)
        return self._spheres


def slots_of(law: Law, seen: Sighting) -> Any:
    """The obstacles that are `seen`, in the slots in which the `step` of a `law` takes them; None for one without."""
    return _Obstacles(law.obstacles).of(seen)


def _warm_up(law: Law, state: ArmState, seen: Sighting, obstacles: _Obstacles, speed: float) -> None:
    zeros = np.zeros_like(state.q_d)
    for _ in range(_WARM):
        law.step(seen.T_world_object, obstacles.of(seen), state.q_d, state.q, *(zeros,) * 3, np.float32(speed))
        law.brake(state.q_d, state.q, *(zeros,) * 3)


@contextlib.contextmanager
def _no_garbage() -> Iterator[None]:
    """Without Python's collector of garbage, which stops a thread for milliseconds."""
    gc.collect()
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


@contextlib.contextmanager
def _scheduled(priority: int) -> Iterator[bool]:
    """With a `priority` of real-time scheduling, zero for none; whether the system let us."""
    if not priority or not hasattr(os, "sched_setscheduler"):
        yield False
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, *before)
