"""NVIDIA's files as users write them: what is read, and what is refused with its key and line."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, UnknownNameError
from jaxrmp.io import load_lula
from jaxrmp.io._yaml import read_yaml

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
    """Load the three files, after replacing the first text by the second in one of them."""

    def load(kind="yaml", old="", new=""):
        texts = {"urdf": URDF, "xrdf": XRDF, "yaml": YAML}
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


def test_entries_that_never_act_are_accepted_and_reported(load):
    trajectory = "cspace_trajectory_rmp: {p_gain: 100., d_gain: 10., ff_gain: .25, weight: 50.}\n    damping_rmp:"
    assert load("yaml", "damping_rmp:", trajectory).inactive == ("cspace_trajectory_rmp",)
    assert load("yaml", "accept_user_weights: no", "accept_user_weights: yes").inactive == (
        "axis_target_rmp.accept_user_weights",
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
        ("yaml", "projection_tolerance: .01", "projection_tolerance: 0", ConfigurationError, "must be positive"),
        ("yaml", "verbose: false", "verbose: 3", ConfigurationError, "expected true or false, received '3'"),
        ("yaml", "- name: tip", "- name: tipp", UnknownNameError, r"frame 'tipp'.*Did you mean 'tip'.*line 63"),
        ("yaml", "[0, 0, .333]", "[0, 0]", ConfigurationError, r"body_cylinders\[0\]\.pt1, line 61"),
        ("yaml", "rmp_params:", "rmp_params: [", ConfigurationError, "is not YAML: .*line 2, column 13"),
        ("xrdf", "      lower:", "      lowr:", UnknownNameError, r"frame 'lowr'.*Did you mean 'lower'.*line 20"),
        ("xrdf", '["tip"]', '["tap"]', UnknownNameError, r"frame 'tap'.*line 8"),
        ("xrdf", "{lower: 0.01}", "{lour: 0.01}", UnknownNameError, "frame 'lour'.*line 11"),
        ("xrdf", "radius: 5e-2", "radius: -5e-2", ConfigurationError, r"line 22: a radius must not be negative"),
        ("xrdf", "{lower: 0.01}", "{lower: -0.2}", ConfigurationError, r"buffer_distance\.lower, line 11: .* -0.15"),
        ("xrdf", "radius: 5e-2", "radius: wide", ConfigurationError, "line 22: expected a number, received 'wide'"),
        ("xrdf", "clone: arm", "clone: arn", UnknownNameError, "geometry 'arn'. Did you mean 'arm'"),
        ("xrdf", "clone: arm", "clone: all", ConfigurationError, "geometry clones itself"),
        ("xrdf", ", slide: .05", "", ConfigurationError, r"joints \['slide'\].*neither in cspace nor in default"),
        ("xrdf", "shoulder: 0.1, ", "", ConfigurationError, "joint shoulder of cspace has no position"),
        ("xrdf", '"elbow", "shoulder"', '"elbow", "shulder"', ConfigurationError, "joint shulder of cspace has no"),
        ("xrdf", "tool_frames", "tools", UnknownNameError, "unknown key 'tools'"),
        ("xrdf", "format: xrdf", "format: urdf", ConfigurationError, "expected xrdf, received 'urdf'"),
        ("xrdf", "tool_frames:", "modifiers: [{set_base_frame: upper}]\ntool_frames:", ConfigurationError,
         "modifiers are not supported"),
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
