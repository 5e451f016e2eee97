"""The whole policy in motion against its formulas in plain NumPy, from the files to the root.

The published vector is at rest, so it says nothing about damping, velocity gates, caps and curvature. Here the files
are read, the kinematics computed and the leaves evaluated without jaxrmp; task maps are differentiated numerically.
"""

import xml.etree.ElementTree as ElementTree

import jax
import numpy as np
import pytest
import yaml

from benchmarks._policies import world_of

X_AXIS = np.array([0.0, 0.6, -0.8])


def sig(z):
    return 1 / (1 + np.exp(np.clip(z, -700, 700)))


def rpy(roll, pitch, yaw):
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def about(axis, angle):
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


class Arm:
    """A URDF file: the pose of a link for positions of the joints by name."""

    def __init__(self, path):
        self.joints = {}
        for joint in ElementTree.parse(path).getroot().findall("joint"):
            origin, axis = joint.find("origin"), joint.find("axis")
            T = np.eye(4)
            if origin is not None:
                T[:3, :3] = rpy(*map(float, origin.get("rpy", "0 0 0").split()))
                T[:3, 3] = [float(v) for v in origin.get("xyz", "0 0 0").split()]
            a = np.array([float(v) for v in axis.get("xyz").split()]) if axis is not None else None
            parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
            self.joints[child] = (parent, T, joint.get("type"), a, joint.get("name"), joint.find("limit"))

    def range(self, name):
        (limit,) = (limit for *_, joint, limit in self.joints.values() if joint == name)
        return float(limit.get("lower")), float(limit.get("upper"))

    def poses(self, position):
        found = {}

        def pose(link):
            if link not in self.joints:
                return np.eye(4)
            if link not in found:
                parent, T, kind, axis, name, _ = self.joints[link]
                move = np.eye(4)
                if kind == "revolute":
                    move[:3, :3] = about(axis, position[name])
                elif kind == "prismatic":
                    move[:3, 3] = axis * position[name]
                found[link] = pose(parent) @ T @ move
            return found[link]

        return pose


def pulled_back(psi, formula, q, qd):
    """`J^T (f - M Jdot qd)`, `J^T M J` of a formula on y = psi(q), by central differences."""
    h, n = 1e-5, len(q)
    J = np.stack([(psi(q + h * e) - psi(q - h * e)) / (2 * h) for e in np.eye(n)], axis=1)
    h = 3e-4
    c = (psi(q + h * qd) - 2 * psi(q) + psi(q - h * qd)) / h**2
    f, M = formula(psi(q), J @ qd)
    return J.T @ (f - M @ c), J.T @ M @ J


def diagonal(a, m):
    return m * a, np.diag(m)


def leaves(arm, names, golden, xrdf, config):
    """Pairs of task map and formula, after NVIDIA's description of each leaf."""
    rmp = {s: {k: float(v) for k, v in keys.items()} for s, keys in config["rmp_params"].items()}
    defaults = {k: float(v) for k, v in xrdf["default_joint_positions"].items()}

    def at(q):
        return arm.poses({**defaults, **dict(zip(names, q, strict=True))})

    def identity(q):
        return q

    def tip(q):
        return at(q)(golden["frame"])[:3, 3]

    p = rmp["cspace_target_rmp"]
    posture = np.array(golden["cspace_attractor"])

    def cspace_target(x, xd, p=p):
        offset = posture - x
        offset = offset / max(1.0, np.linalg.norm(offset) / p["robust_position_term_thresh"])
        a = p["position_gain"] * offset - p["damping_gain"] * xd
        return p["metric_scalar"] * a, (p["metric_scalar"]) * np.eye(len(x))

    yield identity, cspace_target
    yield identity, lambda x, xd, m=p["inertia"]: (0 * x, m * np.eye(len(x)))

    buffers = np.array(config["joint_limit_buffers"], float)
    lower, upper = np.array([arm.range(name) for name in names]).T + [buffers, -buffers]

    def joint_limit(x, xd, p=rmp["joint_limit_rmp"]):
        a = p["accel_potential_gain"] / (
            x**2 / p["accel_potential_exploder_length_scale"] ** 2 + p["accel_potential_exploder_eps"]
        )
        m = sig(xd / p["metric_velocity_gate_length_scale"]) * p["metric_scalar"]
        m = m / (x / p["metric_length_scale"] + p["metric_exploder_eps"])
        return diagonal(a - p["accel_damper_gain"] * xd, m)

    yield lambda q: (q - lower) / (upper - lower), joint_limit
    yield lambda q: (upper - q) / (upper - lower), joint_limit

    def velocity_cap(x, xd, p=rmp["joint_velocity_cap_rmp"]):
        s = abs(xd) - (p["max_velocity"] - p["velocity_damping_region"])
        m = np.where(s < 0, 0, p["metric_weight"] / (1 - s**2 / p["velocity_damping_region"] ** 2))
        return diagonal(-p["damping_gain"] * np.sign(xd) * s, m)

    yield identity, velocity_cap

    target = np.array(golden["position_target"])

    def position_target(x, xd, p=rmp["target_rmp"]):
        delta = target - x
        r = np.linalg.norm(delta)
        a = p["accel_p_gain"] * delta / (r + p["accel_norm_eps"]) - p["accel_d_gain"] * xd
        alpha = np.exp(-(r**2) / (2 * p["metric_alpha_length_scale"] ** 2))
        alpha = (1 - p["min_metric_alpha"]) * alpha + p["min_metric_alpha"]
        beta = np.exp(-(r**2) / (2 * p["proximity_metric_boost_length_scale"] ** 2))
        M = alpha * p["max_metric_scalar"] * np.eye(3)
        M = M + (1 - alpha) * p["min_metric_scalar"] * np.outer(delta, delta) / r**2
        M = (beta * p["proximity_metric_boost_scalar"] + 1 - beta) * M
        return M @ a, M

    yield tip, position_target

    def axis_target(x, xd, p=rmp["axis_target_rmp"]):
        r = np.linalg.norm(target - x[3:])
        beta = np.exp(-(r**2) / (2 * p["proximity_metric_boost_length_scale"] ** 2))
        m = (beta * p["proximity_metric_boost_scalar"] + 1 - beta) * p["metric_scalar"] * np.array([1, 1, 1, 0, 0, 0])
        a = p["accel_p_gain"] * (np.array([*X_AXIS, 0, 0, 0]) - x) - p["accel_d_gain"] * xd
        return diagonal(a, m)

    yield lambda q: np.concatenate([at(q)(golden["frame"])[:3, 0], tip(q)]), axis_target

    p = rmp["damping_rmp"]

    def damping(x, xd, p=p):
        speed = np.linalg.norm(xd)
        return diagonal(-p["accel_d_gain"] * speed * xd, p["metric_scalar"] * speed * np.ones(3))

    yield tip, damping
    yield tip, lambda x, xd, m=p["inertia"]: (0 * x, m * np.eye(3))

    def collision(d, dd, p=rmp["collision_rmp"]):
        x, gate = np.maximum(d, 0), sig(dd / p["damping_velocity_gate_length_scale"])
        a = p["repulsion_gain"] * np.exp(-x / p["repulsion_std_dev"])
        a = a - p["damping_gain"] * gate * dd / (x / p["damping_std_dev"] + p["damping_robustness_eps"])
        m = gate * (1 - x / p["metric_modulation_radius"]) ** 2 * p["metric_scalar"]
        m = m / (x / p["metric_exploder_std_dev"] + p["metric_exploder_eps"])
        return diagonal(a, np.where(x <= p["metric_modulation_radius"], m, 0))

    frames = xrdf["geometry"][xrdf["world_collision"]["geometry"]]["spheres"]
    spheres = [(link, np.array([*s["center"], 1.0]), float(s["radius"])) for link in frames for s in frames[link]]

    def to_obstacles(q):
        pose, found = at(q), []
        for link, center, radius in spheres:
            c = (pose(link) @ center)[:3]
            for obstacle in golden["obstacles"]:
                offset = c - obstacle["center"]
                if obstacle["type"] == "sphere":
                    found.append(np.linalg.norm(offset) - obstacle["radius"] - radius)
                else:
                    beyond = abs(offset) - np.array(obstacle["side_lengths"]) / 2
                    outside = np.linalg.norm(np.maximum(beyond, 0))
                    found.append((outside if outside > 0 else beyond.max()) - radius)
        return np.array(found)

    yield to_obstacles, collision

    def to_base(q):
        pose, found = at(q), []
        for controller in config["body_collision_controllers"]:
            c = pose(controller["name"])[:3, 3]
            for capsule in config["body_capsules"]:
                start, end = np.array(capsule["pt1"], float), np.array(capsule["pt2"], float)
                t = np.clip((c - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
                found.append(np.linalg.norm(c - start - t * (end - start)) - capsule["radius"] - controller["radius"])
        return np.array(found)

    yield to_base, collision


@pytest.fixture(scope="module")
def transcription(folder, golden):
    xrdf = yaml.safe_load((folder / golden["xrdf"]).read_text())
    config = yaml.safe_load((folder / golden["config"]).read_text())
    every = list(leaves(Arm(folder / golden["urdf"]), xrdf["cspace"]["joint_names"], golden, xrdf, config))

    def root(q, qd):
        parts = [pulled_back(psi, formula, q, qd) for psi, formula in every]
        return sum(f for f, _ in parts), sum(M for _, M in parts)

    return root


def test_force_and_metric_in_motion_are_those_of_the_formulas(policy, golden, transcription):
    with jax.enable_x64(True):
        tree = policy.tree(
            frame=golden["frame"],
            position_target=golden["position_target"],
            cspace_target=golden["cspace_attractor"],
            x_axis_target=X_AXIS,
            world=world_of(golden, free=1),
        )
        root = jax.jit(lambda tree, q, qd: tree(q, qd))
        rng = np.random.default_rng(0)
        middle = np.array(golden["q"], float) + [0, 0, 0, 0.3, 0, 0, 0]  # away from the limit of joint 4
        for scale in (0.0, 0.05, 0.3, 1.0, 1.5):
            q = middle + 0.2 * rng.uniform(-1, 1, 7)
            qd = scale * rng.uniform(-1, 1, 7)  # the last beyond the cap's threshold of 1.35 rad/s, but not its pole
            if scale == 1.5:
                qd[:2] = 1.45, -1.5
            form, (f, M) = root(tree, q, qd), transcription(q, qd)
            np.testing.assert_allclose(form.M, M, rtol=1e-6, atol=1e-6 * np.abs(M).max())
            np.testing.assert_allclose(form.f, f, rtol=1e-6, atol=1e-6 * np.abs(f).max())
