"""A drive stops for every reason that it watches for, and brakes within limits."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ArmError, ConfigurationError
from jaxrmp.hardware import (
    DriveEnd,
    DriveSettings,
    Fixed,
    MujocoArm,
    check_start,
    drive,
    law,
    to_posture,
)
from jaxrmp.leaves import Posture
from jaxrmp.policies import ArmPolicy, damping, posture

from .conftest import START, arm_at, stands, within_limits


class Sighted:
    """Sightings of a fixed pose, each changed by a function of how many there were."""

    def __init__(self, T, change):
        self._fixed, self._change, self._count = Fixed(T), change, 0

    def newest(self):
        self._count += 1
        return self._change(self._fixed.newest(), self._count)

    def close(self):
        pass


def test_a_tracker_that_goes_silent_stops_it(scene, reach):
    reaching, T, _ = reach
    arm = arm_at(scene)
    silent = Sighted(T, lambda seen, k: seen._replace(age=max(0.0, (k - 600) * 1e-3)))
    found = drive(arm, reaching, silent, DriveSettings(keep=0.3), start=START)
    assert found.end == DriveEnd.STOPPED and "tracker is silent" in found.reason
    assert stands(found, arm)


def test_a_policy_that_is_no_number_stops_it(scene):
    robot = scene.robot

    class Broken:
        def __init__(self):
            self.robot = robot

        def tree(self, T, world):
            return posture(robot, jnp.asarray(START) + 0.5 * jnp.sqrt(T[0, 3]), weight=1.0, stiffness=9.0) + damping()

    broken = law(Broken(), arm_at(scene))
    T = np.eye(4)
    T[0, 3] = 1.0
    negative = T.copy()
    negative[0, 3] = -1.0
    sights = Sighted(T, lambda seen, k: seen._replace(T_world_object=T if k < 700 else negative, number=k // 700))
    arm = arm_at(scene)
    found = drive(arm, broken, sights)
    assert found.end == DriveEnd.STOPPED and "not finite" in found.reason
    assert np.isfinite(found.log.arrays()["log_velocities_told"]).all()
    assert stands(found, arm)


def test_cycles_that_come_late_stop_it(scene, reach):
    reaching, T, _ = reach

    class Away(MujocoArm):
        def read(self):
            if 0.8 < self.data.time < 0.82:
                for _ in range(50):
                    super().read()
            return super().read()

    arm = Away(scene, START, real_time=False)
    found = drive(arm, reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.STOPPED and "ms passed between two cycles" in found.reason and found.late >= 1
    assert stands(found, arm)


def test_what_is_in_its_way_stops_it(scene, reach):
    reaching, T, _ = reach

    class Held(MujocoArm):
        def read(self):
            state = super().read()
            if self.data.time > 0.7:  # somebody holds the arm
                self.data.qpos[self.scene.arm_qpos] = self.held
                self.data.qvel[self.scene.arm_dofs] = 0.0
            self.held = self.data.qpos[self.scene.arm_qpos].copy()
            return state

    arm = Held(scene, START, real_time=False)
    found = drive(arm, reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.STOPPED and "something is in its way" in found.reason


def test_the_end_of_a_range_stops_it(scene):
    robot = scene.robot
    beyond = Posture(START + np.array([0, 0, 0, 0, 0, 4.0, 0]), weight=1.0, stiffness=4.0, damping_rate=3.0)
    policy = ArmPolicy(robot, (), beyond)
    arm = arm_at(scene)
    found = drive(arm, law(policy, arm), Fixed(np.eye(4)), DriveSettings(margin=0.01))
    assert found.end == DriveEnd.STOPPED and "joint 6 is at the end of its range" in found.reason
    assert found.state.q[5] < robot.upper[5]
    assert stands(found, arm)


def test_time_and_interruption_end_it(scene, reach):
    reaching, T, _ = reach
    arm = arm_at(scene)
    found = drive(arm, reaching, Fixed(T), DriveSettings(duration=0.8), start=START)
    assert found.end == DriveEnd.TIME and "within 0.8 s" in found.reason and stands(found, arm)
    arm, asked = arm_at(scene), iter(range(10_000))
    found = drive(arm, reaching, Fixed(T), start=START, running=lambda: next(asked) < 500)
    assert found.end == DriveEnd.INTERRUPTED and stands(found, arm)


def test_an_arm_that_gives_up_keeps_the_log(scene, reach):
    reaching, T, _ = reach

    class Gone(MujocoArm):
        def read(self):
            if self.data.time > 1.0:
                raise ArmError("the arm: its cable is out")
            return super().read()

    found = drive(Gone(scene, START, real_time=False), reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.BY_ARM and "cable is out" in found.reason
    assert found.log.count > 500 and np.isfinite(found.log.arrays()["joint_positions"]).all()


def test_energy_that_rises_by_itself_stops_it(scene, reach):
    reaching, T, _ = reach
    calls = iter(range(10_000))

    def wrong(*arguments):  # a law whose energy rises though nothing is seen to change
        step = reaching.step(*arguments)
        return step._replace(energy=np.float32(10.0 + 0.02 * next(calls)))

    arm = arm_at(scene)
    found = drive(arm, reaching._replace(step=wrong), Fixed(T), start=START)
    assert found.end == DriveEnd.STOPPED and "energy rose" in found.reason and stands(found, arm)
    moving = Sighted(T, lambda seen, k: seen._replace(number=k))  # what moves may raise it
    found = drive(arm_at(scene), reaching._replace(step=wrong), moving, DriveSettings(duration=1.0), start=START)
    assert found.end == DriveEnd.TIME


def test_a_joint_that_is_too_fast_stops_it(scene, reach):
    reaching, T, _ = reach

    class Thrown(MujocoArm):
        def read(self):
            state = super().read()
            return state._replace(qd=state.qd + np.float32(4.0)) if self.data.time > 1.0 else state

    found = drive(Thrown(scene, START, real_time=False), reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.STOPPED and "times its limit" in found.reason


class Lagging(MujocoArm):
    """An arm that drifts behind what it is told."""

    def read(self):
        state = super().read()
        return state._replace(q=state.q - np.float32(0.03))


@pytest.mark.parametrize("share", [1.0, 0.05])
def test_what_mends_drift_keeps_the_limits(scene, homing, share):
    arm = Lagging(scene, START, real_time=False)
    limits = {name: share * getattr(arm.limits, name) for name in ("velocity", "acceleration", "jerk")}
    arm.limits = dataclasses.replace(arm.limits, **limits)
    slow = homing if share == 1.0 else law(to_posture(scene.robot, START + 0.3), arm)
    found = drive(arm, slow, Fixed(np.eye(4)), DriveSettings(duration=2.0))
    assert found.log.count > 1000
    within_limits(found.log.arrays()["log_command"].astype(float), arm)


def test_whatever_fails_on_our_side_brakes_the_arm_and_keeps_the_log(scene, reach):
    reaching, T, _ = reach

    def broken(seen, k):
        if k > 600:
            raise KeyError("a tracker's own fault")
        return seen

    arm = arm_at(scene)
    found = drive(arm, reaching, Sighted(T, broken), start=START)
    assert found.end == DriveEnd.STOPPED and "a tracker's own fault" in found.reason and stands(found, arm)


def test_a_state_that_is_no_number_is_not_answered(scene, reach):
    reaching, T, _ = reach
    sent = []

    class Blind(MujocoArm):
        def read(self):
            state = super().read()
            return state._replace(q=state.q * np.nan, q_d=state.q_d * np.nan) if self.data.time > 1.0 else state

        def send(self, command, last=False):
            sent.append(np.isfinite(command).all())
            super().send(command, last)

    found = drive(Blind(scene, START, real_time=False), reaching, Fixed(T), start=START)
    assert found.end in (DriveEnd.STOPPED, DriveEnd.BY_ARM) and all(sent)
    with pytest.raises(ConfigurationError, match="not at the start"):
        check_start(np.full(7, np.nan), START, 0.1, scene.robot.joint_names)


def test_a_clock_that_goes_back_stops_it(scene, reach):
    reaching, T, _ = reach

    class Back(MujocoArm):
        def read(self):
            state = super().read()
            return state._replace(time=state.time - 100.0) if self.data.time > 1.0 else state

    arm = Back(scene, START, real_time=False)
    found = drive(arm, reaching, Fixed(T), start=START, interface="torque")
    assert found.end == DriveEnd.STOPPED and "clock" in found.reason
    assert np.abs(np.diff(found.log.arrays()["log_positions_told"], axis=0)).max() < 0.02


def test_a_reflex_while_it_ends_is_no_success(scene, reach):
    reaching, T, _ = reach

    class Reflex(MujocoArm):
        def send(self, command, last=False):
            if last:
                raise ArmError("the arm: reflex")
            super().send(command, last)

    found = drive(Reflex(scene, START, real_time=False), reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.BY_ARM and "came to rest; then the arm: reflex" in found.reason
