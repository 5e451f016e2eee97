"""NVIDIA's files as users write them: what is read, and what is refused with its key and line."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, FileWarning, RobotError, UnknownNameError, UnsafeFileWarning
from jaxrmp.io import load_lula
from jaxrmp.io._yaml import read_yaml
from jaxrmp.kinematics import forward_kinematics

URDF = """<robot name="two">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="finger"/><link name="tip"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="2" effort="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="3" velocity="2" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="lower"/><child link="finger"/><origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
  <joint name="end" type="fixed"><parent link="finger"/><child link="tip"/><origin xyz="0.1 0 0"/></joint>
</robot>
"""

XRDF = """format: xrdf
format_version: 1.0
default_joint_positions: {shoulder: 0.1, elbow: 1e-1, slide: .05}
cspace:
  joint_names: ["elbow", "shoulder"]
  acceleration_limits: [15.0, 7.5]
  jerk_limits: [7500.0, 3750.0]
tool_frames: ["tip"]
collision:
  geometry: all
  buffer_distance: {lower: 0.01}
geometry:
  all:
    clone: arm
    spheres:
      finger:
        - {center: [0, 0, 0], radius: 0.02}
  arm:
    spheres:
      lower:
        - center: [0.1, 0.0, 0.0]
          radius: 5e-2
"""

ADD = (
    "{add_frame: {frame_name: held, parent_frame_name: tip, joint_name: hold, joint_type: FIXED, fixed_transform: "
    "{position: [0, 0, 0.1], orientation: {w: 0.0, xyz: [1.0, 0.0, 0.0]}}}}"
)

YAML = """joint_limit_buffers: [.01, .02]
rmp_params:
    cspace_target_rmp:
        metric_scalar: 50.
        position_gain: 100.
        damping_gain: 50.
        robust_position_term_thresh: .5
        inertia: 1.
    joint_limit_rmp:
        metric_scalar: 1000.
        metric_length_scale: .01
        metric_exploder_eps: 1e-3
        metric_velocity_gate_length_scale: .01
        accel_damper_gain: 200.
        accel_potential_gain: 1.
        accel_potential_exploder_length_scale: .1
        accel_potential_exploder_eps: 1e-2
    joint_velocity_cap_rmp:
        max_velocity: 1.
        velocity_damping_region: .3
        damping_gain: 1000.0
        metric_weight: 100.
    target_rmp:
        accel_p_gain: 30.
        accel_d_gain: 85.
        accel_norm_eps: .075
        metric_alpha_length_scale: .05
        min_metric_alpha: .01
        max_metric_scalar: 10000
        min_metric_scalar: 2500
        proximity_metric_boost_scalar: 20.
        proximity_metric_boost_length_scale: .02
        accept_user_weights: false
    axis_target_rmp:
        accel_p_gain: 210.
        accel_d_gain: 60.
        metric_scalar: 10
        proximity_metric_boost_scalar: 3000.
        proximity_metric_boost_length_scale: .08
        accept_user_weights: no
    collision_rmp:
        damping_gain: 50.
        damping_std_dev: .04
        damping_robustness_eps: 1e-2
        damping_velocity_gate_length_scale: .01
        repulsion_gain: 800.
        repulsion_std_dev: .01
        metric_modulation_radius: .5
        metric_scalar: 10000.
        metric_exploder_std_dev: .02
        metric_exploder_eps: .001
    damping_rmp:
        accel_d_gain: 30.
        metric_scalar: 50.
        inertia: 100.
canonical_resolve:
    max_acceleration_norm: 50.
    projection_tolerance: .01
    verbose: false
body_cylinders:
    - {name: stem, pt1: [0, 0, .333], pt2: [0, 0, 0.], radius: .05}
body_collision_controllers:
    - name: tip
      radius: .05
"""


@pytest.fixture
def load(tmp_path):
    """Load the three files, after replacing the first text by the second in one of them, also for later calls."""

    texts = {"urdf": URDF, "xrdf": XRDF, "yaml": YAML}

    def load(kind="yaml", old="", new=""):
        assert old in texts[kind]
        texts[kind] = texts[kind].replace(old, new, 1)
        for name, text in texts.items():
            (tmp_path / f"two.{name}").write_text(text)
        return load_lula(*(tmp_path / f"two.{name}" for name in texts))

    return load


def test_what_the_files_say_is_what_the_policy_has(load):
    policy = load()
    assert policy.robot.joint_names == ("shoulder", "elbow")
    # The XRDF's order is the other way round, and the buffers are in that order.
    np.testing.assert_allclose(policy.joint_limit.lower, [-2 + 0.02, -1 + 0.01])
    np.testing.assert_allclose(policy.joint_limit.upper, [2 - 0.02, 3 - 0.01])
    np.testing.assert_allclose(policy.cspace_target.target, [0.1, 0.1])
    assert policy.joint_limit.metric_exploder_eps == 1e-3
    assert policy.spheres.frames == ("lower", "finger")
    np.testing.assert_allclose(policy.spheres.radii, [0.06, 0.02])
    assert policy.frame == "tip" and policy.inactive == ()
    assert policy.base.size == 1 and policy.controllers.frames == ("tip",)
    tip = policy.controllers.points(policy.robot)(jnp.zeros(2))
    np.testing.assert_allclose(tip[0], [0.4 + 0.3 + 0.05 + 0.1, 0, 0.5], atol=1e-6)


def test_modifiers_add_frames_and_set_the_base(load):
    """The base's own frame is where the origin is; a frame that was added carries spheres and is a tool."""
    urdf = '<link name="stand"/><joint name="mount" type="fixed"><parent link="stand"/><child link="base"/>'
    load("urdf", '<link name="base"/>', urdf + '<origin xyz="1 2 3" rpy="0 0 1"/></joint><link name="base"/>')
    load("xrdf", "tool_frames:", f"modifiers: [{ADD}, {{set_base_frame: base}}]\ntool_frames:")
    policy = load("xrdf", '["tip"]', '["held"]')
    tip, held, stand = forward(policy.robot, "tip", "held", "stand")
    np.testing.assert_allclose(tip[:3, 3], [0.4 + 0.3 + 0.05 + 0.1, 0, 0.5], atol=1e-6)
    np.testing.assert_allclose(held[:3, 3] - tip[:3, 3], [0, 0, 0.1], atol=1e-6)
    np.testing.assert_allclose(held[:3, :3], np.diag([1, -1, -1]), atol=1e-6)
    np.testing.assert_allclose(np.linalg.inv(stand)[:3, 3], [1, 2, 3], atol=1e-6)
    assert policy.frame == "held"
    form = jax.eval_shape(policy.tree(position_target=jnp.ones(3)), jnp.zeros(2), jnp.zeros(2))
    assert form.M.shape == (2, 2)


def forward(robot, *frames):
    poses = jax.jit(lambda q: [forward_kinematics(robot, q, frame) for frame in frames])
    return jax.tree.map(np.asarray, poses(np.zeros(robot.num_joints)))


def test_a_radius_below_zero_is_filled_by_its_buffer_or_off(load):
    negative = "radius: 5e-2\n        - {center: [0, 0, 0], radius: -0.005}\n        - {center: [0, 0, 0], radius: -10}"
    with pytest.warns(FileWarning, match="1 spheres of lower are off"):
        policy = load("xrdf", "radius: 5e-2", negative)
    np.testing.assert_allclose(policy.spheres.radii, [0.06, 0.005, 0.02])


def test_of_a_key_given_twice_the_last_counts(load):
    with pytest.warns(
        UnsafeFileWarning, match=r"geometry\.arm\.spheres\.lower, line 23, was given in line 20 with another"
    ):
        policy = load("xrdf", "radius: 5e-2\n", "radius: 5e-2\n      lower: [{center: [0, 0, 0], radius: 0.04}]\n")
    np.testing.assert_allclose(policy.spheres.radii, [0.05, 0.02])
    with pytest.warns(FileWarning, match=r"tool_frames, line 9, was given in line 8 with the same value"):
        load("xrdf", 'tool_frames: ["tip"]\n', 'tool_frames: ["tip"]\ntool_frames: ["tip"]\n')


def test_default_positions_of_joints_that_follow_are_left_out(load):
    follower = '<joint name="jaw" type="prismatic"><parent link="finger"/><child link="jaw"/><axis xyz="0 1 0"/>'
    follower += '<limit lower="0" upper="0.2" velocity="1" effort="1"/><mimic joint="slide" multiplier="2"/></joint>'
    load("urdf", '  <joint name="end"', f'<link name="jaw"/>{follower}<joint name="end"')
    assert load("xrdf", "slide: .05}", "slide: .05, jaw: 0.1004}").robot.num_joints == 2
    with pytest.warns(FileWarning, match=r"jaw \(it follows slide, to 0.1\) are left out"):
        load("xrdf", "jaw: 0.1004", "jaw: 0.02")
    robot = load("xrdf", "slide: .05, ", "").robot  # the joint that it follows has no default of its own
    assert {j.name: round(j.offset, 6) for j in robot.model.joints if j.coordinate < 0} == {"slide": 0.01, "jaw": 0.02}


def test_defaults_are_rounded_to_limits_and_missing_ones_named(load):
    policy = load("xrdf", "slide: .05", "slide: -0.0008")
    assert next(joint.offset for joint in policy.robot.model.joints if joint.name == "slide") == 0.0
    with pytest.warns(FileWarning, match="says nothing of elbow at 0, slide at 0"):
        policy = load("xrdf", "elbow: 1e-1, slide: -0.0008", "base_mount: 0.0")
    np.testing.assert_allclose(policy.cspace_target.target, [0.1, 0])
    with pytest.warns(FileWarning, match="default_joint_positions of base_mount are left out"):
        load()


def test_what_the_urdf_lacks_is_said_once(load):
    with pytest.warns(UnsafeFileWarning, match="velocity limit that is absent") as caught:
        load("urdf", ' velocity="', ' speed="')
    assert sum("velocity limit that is absent" in str(warning.message) for warning in caught) == 1


def test_what_no_policy_acts_on_is_said(load):
    with pytest.warns(FileWarning, match=r"acts on cspace\.acceleration_limits, cspace\.jerk_limits, self_collision"):
        load("xrdf", "geometry:\n", "self_collision: {geometry: all, ignore: {lower: [finger]}}\ngeometry:\n")
    with pytest.warns(UnsafeFileWarning, match="no spheres .*avoids no obstacle"):
        load("xrdf", "collision:\n  geometry: all\n  buffer_distance: {lower: 0.01}\n", "")


def test_entries_that_never_act_are_accepted_and_reported(load):
    trajectory = "cspace_trajectory_rmp: {p_gain: 100., d_gain: 10., ff_gain: .25, weight: 50.}\n    damping_rmp:"
    assert load("yaml", "damping_rmp:", trajectory).inactive == ("cspace_trajectory_rmp",)
    assert load("yaml", "accept_user_weights: no", "accept_user_weights: yes").inactive == (
        "axis_target_rmp.accept_user_weights",
        "cspace_trajectory_rmp",
    )


@pytest.mark.parametrize(
    ("kind", "old", "new", "error", "match"),
    [
        ("yaml", "accel_p_gain: 30.", "accel_p_gain: abc", ConfigurationError,
         r"key rmp_params\.target_rmp\.accel_p_gain, line 24: expected a number, received 'abc'"),
        ("yaml", "accel_p_gain: 30.", 'accel_p_gain: "30"', ConfigurationError, "line 24: expected a number"),
        ("yaml", "accel_p_gain: 30.", "accel_p_gain: .inf", ConfigurationError, "line 24: expected a number"),
        ("yaml", "accel_p_gain: 30.", "accel_p_gain: [1]", ConfigurationError, "received a list of 1"),
        ("yaml", "accel_p_gain: 30.", "accel_p_gain: -1", ConfigurationError, "line 24: must not be negative"),
        ("yaml", "accel_norm_eps: .075", "accel_norm_eps: 0", ConfigurationError, "line 26: must be positive"),
        ("yaml", "accel_p_gain", "accel_pgain", UnknownNameError,
         r"unknown key of rmp_params\.target_rmp 'accel_pgain'\. Did you mean 'accel_p_gain'\?.*line 24"),
        ("yaml", "target_rmp:\n        accel", "taget_rmp:\n        accel", UnknownNameError,
         r"unknown key of rmp_params 'taget_rmp'\. Did you mean 'target_rmp'"),
        ("yaml", "        accel_norm_eps: .075\n", "", ConfigurationError,
         r"rmp_params\.target_rmp, line 23 lacks the keys accel_norm_eps"),
        ("yaml", "accel_d_gain: 85.", "accel_p_gain: 85.", ConfigurationError, "line 25, was given in line 24"),
        ("yaml", "[.01, .02]", "[.01]", ConfigurationError, "joint_limit_buffers, line 1: expected a list of 2"),
        ("yaml", "[.01, .02]", "[.01, -.02]", ConfigurationError, "joint_limit_buffers, line 1: .*not be negative"),
        ("yaml", "[.01, .02]", "[2.5, .02]", RobotError, "leave no range: elbow from 1.5 to 0.5"),
        ("yaml", "projection_tolerance: .01", "projection_tolerance: 0", ConfigurationError, "must be positive"),
        ("yaml", "verbose: false", "verbose: 3", ConfigurationError, "expected true or false, received '3'"),
        ("yaml", "- name: tip", "- name: tipp", UnknownNameError, r"frame 'tipp'.*Did you mean 'tip'.*line 63"),
        ("yaml", "[0, 0, .333]", "[0, 0]", ConfigurationError, r"body_cylinders\[0\]\.pt1, line 61"),
        ("yaml", "rmp_params:", "rmp_params: [", ConfigurationError, "is not YAML: .*line 2, column 13"),
        ("xrdf", "      lower:", "      lowr:", UnknownNameError, r"frame 'lowr'.*Did you mean 'lower'.*line 20"),
        ("xrdf", '["tip"]', '["tap"]', UnknownNameError, r"frame 'tap'.*line 8"),
        ("xrdf", "{lower: 0.01}", "{lour: 0.01}", UnknownNameError, "frame 'lour'.*line 11"),
        ("xrdf", "{lower: 0.01}", "{lower: -0.2}", ConfigurationError, r"buffer_distance\.lower, line 11: .* -0.15"),
        ("xrdf", "radius: 5e-2", "radius: wide", ConfigurationError, "line 22: expected a number, received 'wide'"),
        ("xrdf", "clone: arm", "clone: arn", UnknownNameError, "geometry 'arn'. Did you mean 'arm'"),
        ("xrdf", "clone: arm", "clone: all", ConfigurationError, "geometry clones itself"),
        ("xrdf", "slide: .05", "slide: .12", ConfigurationError,
         r"default_joint_positions\.slide, line 3: 0.12 is outside the limits of joint slide, from 0 to 0.1"),
        ("xrdf", "shoulder: 0.1", "shoulder: -2.1", ConfigurationError, r"\.shoulder, line 3: -2.1 is outside"),
        ("xrdf", '"elbow", "shoulder"', '"elbow", "shulder"', UnknownNameError, "joint 'shulder'.*mean 'shoulder'"),
        ("xrdf", '"elbow", "shoulder"', '"elbow", "elbow"', ConfigurationError, "line 5: joint elbow is named twice"),
        ("xrdf", "tool_frames", "tools", UnknownNameError, "unknown key 'tools'"),
        ("xrdf", "format: xrdf", "format: urdf", ConfigurationError, "expected xrdf, received 'urdf'"),
        ("xrdf", "tool_frames:", "modifiers: [{set_base_frame: upper}]\ntool_frames:", ConfigurationError,
         r"line 8: frame 'upper' is moved by joints \['shoulder'\]"),
        ("xrdf", "tool_frames:", "modifiers: [{set_base_frame: bass}]\ntool_frames:", UnknownNameError,
         r"frame 'bass'.*mean 'base'.*line 8"),
        ("xrdf", "tool_frames:", "modifiers: [{set_base: base}]\ntool_frames:", UnknownNameError, "set_base_frame"),
        ("xrdf", "tool_frames:", f"modifiers: [{ADD.replace('held', 'tip')}]\ntool_frames:", ConfigurationError,
         "frame 'tip' is in the URDF"),
        ("xrdf", "tool_frames:", f"modifiers: [{ADD.replace('FIXED', 'REVOLUTE')}]\ntool_frames:", ConfigurationError,
         "only FIXED frames can be added, not REVOLUTE"),
        ("xrdf", "tool_frames:", f"modifiers: [{ADD.replace('w: 0.0', 'w: 1.0')}]\ntool_frames:", ConfigurationError,
         "unit quaternion, received one of length 1.414"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_by_key_and_line(load, kind, old, new, error, match):
    with pytest.raises(error, match=match):
        load(kind, old, new)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match=r"nothing\.yaml cannot be read"):
        read_yaml(tmp_path / "nothing.yaml")
    (tmp_path / "empty.yaml").write_text("# nothing\n")
    with pytest.raises(ConfigurationError, match=r"empty\.yaml is empty"):
        read_yaml(tmp_path / "empty.yaml")
