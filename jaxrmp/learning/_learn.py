"""From demonstrations to a skill, by a flow of the whole hand or by the paper's steps."""

import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._errors import FileWarning, JaxrmpError, TrainingError
from ..kinematics import Robot, record_of
from ..leaves import Learned
from ..xla import as_here
from ._configuration import Configuration
from ._demonstrations import DemonstrationSet
from ._families import Families, families
from ._flow_training import check_stretch
from ._hand_flow import HandFlow
from ._learn_flow import FlowLearning, flow_lesson, learn_flow, led_along
from ._learn_paper import PaperLearning, learn_paper
from ._own_clearance import OwnClearance, own_clearance
from ._prepare import PreparedDemonstrations, control_point_frames, control_point_names, demonstrated_end, prepare
from ._progress import Progress, Shown, shown
from ._reproduce import Reproduction, compile_ahead, reproduce, rollout_duration
from ._skill import Skill, joint_leaves, mean_pose, rigid_targets

_GOAL, _RISE = 1.0, 1e-3  # cm, and relative: what a reproduction may miss the goal by, and V rise by
_GOAL_TURN = 2.0  # degrees, where it has no place


class Learning(NamedTuple):
    """A learned `skill` and how it was learned: from `prepared` demonstrations, whose `agreement` is what `families`
    finds, and `clearance` of the robot from itself `own_clearance`; by the `paper`'s steps or a `flow`, the other None;
    its `reproduction` of them, if it was needed to judge it, else None; `why` that method, in words where it was
    chosen; and `seconds` by step."""

    skill: Skill
    prepared: PreparedDemonstrations
    agreement: Families
    clearance: OwnClearance
    paper: PaperLearning | None
    flow: FlowLearning | None
    reproduction: Reproduction | None
    why: str
    seconds: dict[str, float]

    @property
    def losses(self) -> np.ndarray:
        """The training's losses, [updates, P], for each of the skill's `parts`."""
        if self.flow is not None:
            return self.flow.fit.losses[:, None]
        assert self.paper is not None  # one of the two
        return self.paper.metric.losses


def learn(
    configuration: Configuration,
    robot: Robot,
    demonstrations: DemonstrationSet,
    progress: Progress | Shown | None = "shown",
) -> Learning:
    """Learn a skill of several subtasks from a demonstration set.

    By a flow, `learn_flow`, one policy for the whole hand; or by the paper's steps, `learn_paper`, a policy for each
    control point. With the configuration's `method = "auto"` by a flow, and where that does not pass, by the paper's,
    unless a subtask is a whole hand or the tempo is the demonstrated one. A flow passes if it stretches space nowhere
    on the demonstrations beyond what rollouts can follow, and if all of them, reproduced by the whole policy, end at
    the goal, with an energy that does not rise. Before, a `FileWarning` says which demonstrations disagree, as
    `families` finds, in which the robot overlaps itself, as `own_clearance` does, and of a tempo that is to be learned,
    when demonstrations pause, and for how long.

    **Arguments**: `configuration`; `robot`, with the demonstrations' joints in the same order; `demonstrations`;
    `progress`, called with the name of a step and the fraction of it that is done; by default a bar, in a terminal or
    a notebook; None for none.
    **Returns** a `Learning`.
    **Raises** what its steps raise, above all `DemonstrationError`, `ConvexProgramError`, `BasinError`,
    `TrainingError` (a flow that does not pass, too), and `UnknownNameError` for a frame or object that is not there.

    Rana et al. 2019, section 3; docs/concepts.md for the flow.
    """
    with shown(progress) as tell:
        return _learned(configuration, robot, demonstrations, tell)


def _learned(
    configuration: Configuration, robot: Robot, demonstrations: DemonstrationSet, progress: Progress
) -> Learning:
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        seconds[name], clock = seconds.get(name, 0.0) + now - clock, now

    progress("preprocessing", 0.0)
    prepared = prepare(configuration, robot, demonstrations)
    agreement = families(prepared.points)
    if not agreement.agree:
        warnings.warn(f"{demonstrations.source}: {agreement}", FileWarning, stacklevel=3)
    tell_pauses(configuration, demonstrations.source, prepared)
    clearance = own_clearance(robot, prepared.joints.q, bool(configuration.poses.start))
    lap("preprocessing")
    why = "asked for"
    if configuration.method != "paper":
        try:
            duration = rollout_duration(configuration.policy, prepared)
            lesson = flow_lesson(configuration, robot, prepared)
            skill = _skill(configuration, robot, demonstrations, prepared, None, lesson.motion)
            with ThreadPoolExecutor(1) as beside:  # compiles what is to judge a flow while that is trained
                compiling = beside.submit(as_here(compile_ahead), skill, robot, prepared, duration)
                flow = learn_flow(configuration, lesson, progress)
                check_stretch(flow.fit)
                lap("flow")
                progress("reproducing", 0.0)
                compiling.result()
            skill = replace(skill, flow=flow.motion)
            skill = _led_along_its_own_ways(skill, robot, prepared, duration)
            progress("reproducing", 0.5)
            reproduction = reproduce(skill, robot, prepared, duration=duration)
            lap("gate")
            _check(reproduction)
            why = "asked for" if configuration.method == "flow" else "it passes all checks"
            return Learning(skill, prepared, agreement, clearance, None, flow, reproduction, why, seconds)
        except JaxrmpError as error:
            if configuration.method == "flow" or configuration.of_hand:
                raise
            if configuration.policy.tempo != "constant":
                raise TrainingError(
                    f"no flow passes: {error} The paper's method, which knows one speed only, cannot take over with "
                    f"policy.tempo {configuration.policy.tempo!r}. Set that to 'constant', or mend what is said."
                ) from error
            why = f"no flow passes: {error}"
            lap("flow")
        # What a flow may do and this method may not, it refuses here: control points that cross their own way.
        prepared = prepare(replace(configuration, method="paper"), robot, demonstrations)
    paper = learn_paper(configuration, prepared.subtasks, progress)
    lap("paper")
    skill = _skill(configuration, robot, demonstrations, prepared, paper.learned, None)
    return Learning(skill, prepared, agreement, clearance, paper, None, None, why, seconds)


def tell_pauses(configuration: Configuration, source: str, prepared: PreparedDemonstrations) -> None:
    """A `FileWarning` for each demonstration that pauses, if its tempo is to be learned."""
    if configuration.policy.tempo == "constant":
        return
    for k, report in enumerate(prepared.joints.reports):
        if report.paused:
            warnings.warn(
                f"{source}: demonstration {k} pauses: {report.paused}. A policy that goes by where it is cannot wait "
                "there: it goes on.",
                FileWarning,
                stacklevel=3,
            )


def _skill(
    configuration: Configuration,
    robot: Robot,
    demonstrations: DemonstrationSet,
    prepared: PreparedDemonstrations,
    learned: Learned | None,
    flow: HandFlow | None,
) -> Skill:
    frames, offsets = control_point_frames(configuration)
    joint_damping, joint_limit, limited = joint_leaves(robot, configuration.policy)
    return Skill(
        learned=learned,
        flow=flow,
        joint_damping=joint_damping,
        joint_limit=joint_limit,
        offsets=jnp.asarray(offsets, jnp.float32),
        targets=jnp.asarray(rigid_targets(offsets, frames, prepared.subtasks.ends), jnp.float32),
        T_world_object=jnp.asarray(mean_pose(prepared.poses), jnp.float32),
        R_object_hand=jnp.asarray(demonstrated_end(prepared, robot, frames[0])[:3, :3], jnp.float32),
        frames=frames,
        subtasks=control_point_names(configuration),
        limited=limited,
        configuration=configuration if demonstrations.object_names else replace(configuration, object=""),
        robot_fingerprint=robot.fingerprint,
        source=demonstrations.source,
        robot_record=record_of(robot),
    )


def _led_along_its_own_ways(skill: Skill, robot: Robot, prepared: PreparedDemonstrations, duration: float) -> Skill:
    """The skill with its leaves on the joints where it goes itself from where the demonstrations began.

    Joints of a redundant arm go other ways than demonstrated, and the way of the whole policy, which ends at the goal,
    is one on which nothing pulls out of the funnel's tube. Where it ends, the hand is at the goal, as it is not at the
    mean of demonstrated postures: a pull there does not move it.
    """
    motion = skill.flow
    assert motion is not None  # by a flow
    free = motion
    if motion.funnel is not None:
        free = replace(motion, funnel=replace(motion.funnel, weight=jnp.zeros_like(motion.funnel.weight)))
    rollouts = reproduce(replace(skill, flow=free), robot, prepared, duration=duration, own_targets=False).rollouts
    ways = [q.astype(float) for q in rollouts.q]
    if motion.posture is not None:
        ends = np.stack([way[-1] for way in ways])
        middle = np.linalg.norm(ends[:, None] - ends, axis=-1).sum(0).argmin()  # one that is, not a mean of branches
        motion = replace(motion, posture=replace(motion.posture, postures=ends[middle, None].astype(np.float32)))
    return replace(skill, flow=led_along(motion, skill.configuration, robot, ways, prepared.poses))


def _check(reproduction: Reproduction) -> None:
    """**Raises** `TrainingError` for a flow that a robot should not follow."""
    placed = reproduction.mean["goal_cm"] is not None
    name, most, unit = ("goal_cm", _GOAL, "cm") if placed else ("goal_turn_deg", _GOAL_TURN, "degrees")
    goal, rise = (np.array([e[key] for e in reproduction.errors]) for key in (name, "energy_increase"))
    if not (goal <= most).all():
        raise TrainingError(
            f"reproduced by the whole policy, demonstrations {np.flatnonzero(~(goal <= most)).tolist()} end up to "
            f"{goal.max():.1f} {unit} from the goal. Are they one skill? `jaxrmp check` looks at them."
        )
    if not (rise <= _RISE).all():
        raise TrainingError(
            f"the energy rises by {rise.max():.1e} of its range in a reproduction, allowed {_RISE}: steps of 5 ms are "
            "too long for it. Lower policy.damping_rate, or raise flow.conditioning."
        )
