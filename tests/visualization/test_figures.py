"""Figures of learning and reproduction: what they show of small values made by hand, and the fields behind them."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import MissingDependencyError, ShapeError, UnknownNameError
from jaxrmp._pytree import pytree
from jaxrmp.learning import (
    Basin,
    Configuration,
    Learning,
    PaperLearning,
    PotentialChoice,
    PotentialFit,
    PreparedDemonstrations,
    Reproduction,
    Skill,
    Subtask,
    families,
    initial_cholesky_factor,
    subtask_trajectories,
)
from jaxrmp.learning._metric_training import MetricFit
from jaxrmp.learning._own_clearance import OwnClearance
from jaxrmp.learning._potential_choice import WidthTrial, cosines
from jaxrmp.leaves import Damping, Learned, NominalPotential
from jaxrmp.simulation import Rollout
from jaxrmp.visualization import (
    demonstration_plane,
    energy_figure,
    field_on_plane,
    loss_figure,
    save_learning_figures,
    save_reproduction_figures,
    triangle_figure,
    vector_field_figure,
    width_figure,
)
from jaxrmp.visualization._energy import relative_energy
from jaxrmp.visualization._plane import fields_at
from jaxrmp.visualization._space import view_angles
from jaxrmp.visualization._triangles import outlines

NAMES = ("tip", "left/side")
WIDTHS = (0.03, 0.05, 0.08)


def control_points(K=2, N=3, T=40):
    """N nearly straight paths [T, K, 3], m, of K points a little apart, from different starts to one end."""
    s = np.linspace(1.0, 0.0, T)[:, None, None]
    starts = np.array([[-0.4, 0.1 * (n - 1), 0.02 * n] for n in range(N)])[:, None]
    beside = np.array([[0.0, 0.04 * np.cos(a), 0.04 * np.sin(a)] for a in np.arange(K)])
    return tuple(s * start + beside + [0.0, 0.0, 0.03] * np.sin(np.pi * s) for start in starts)


def prepared(K=2):
    points = control_points(K)
    subtasks = subtask_trajectories(points, samples=40)
    return PreparedDemonstrations(None, np.tile(np.eye(4), (3, 1, 1)), points, subtasks, "test frame")


def reproduction(demonstrations, rise=3e-7):
    time = np.tile(np.linspace(0.0, 2.0, 21), (3, 1))
    energy = 5.0 + np.exp(-3.0 * time)
    q = np.exp(-time)[..., None] * np.ones(7)
    points = np.stack([p[::2] + 0.01 for p in demonstrations.points])
    errors = [{"dtw_cm": 1.0 + n, "energy_increase": rise / (n + 1)} for n in range(3)]
    return Reproduction(Rollout(time, q, -q, energy, np.zeros((3, 21, 0)), ()), points, tuple(errors))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(scope="module")
def learning():
    demonstrations = prepared()
    nominal, fits = 1, []
    for positions in demonstrations.subtasks.positions:
        z = positions[nominal]
        potential = NominalPotential(z, np.linalg.norm(z, axis=1), np.zeros(3), 0.05, 30.0)
        fits.append(PotentialFit(potential, "optimal", 0.1, 0.1, 0.0, (1.0, 2.0, 3.0)))
    trials = (
        WidthTrial(WIDTHS[0], "infeasible", float("nan"), float("nan"), None),
        WidthTrial(WIDTHS[1], "", 0.9, 0.01, Basin(50, 1.0, ())),
        WidthTrial(WIDTHS[2], "", 0.8, 0.05, None),
    )
    factors = jax.vmap(initial_cholesky_factor)(jax.random.split(jax.random.key(0), 2))
    potentials = jax.tree.map(
        lambda *a: jnp.stack([jnp.asarray(v, jnp.float32) for v in a]), *[f.potential for f in fits]
    )
    losses = np.geomspace(0.08, 0.005, 20)[:, None] * [1.0, 2.0]
    skill = Skill(
        learned=Learned(potentials, factors, jnp.full(2, 0.2), jnp.full(2, 40.0)),
        joint_damping=Damping(),
        joint_limit=None,
        limited=(),
        offsets=jnp.zeros((2, 3)),
        targets=jnp.zeros((2, 3)),
        T_world_object=jnp.eye(4),
        R_object_hand=jnp.eye(3),
        frames=("hand", "hand"),
        subtasks=NAMES,
        configuration=Configuration("test_skill", tuple(Subtask(name, "hand") for name in NAMES)),
        robot_fingerprint="",
    )
    choices = tuple(PotentialChoice(fit, trials[1], trials) for fit in fits)
    paper = PaperLearning(skill.learned, (nominal,) * 2, choices, MetricFit(factors, losses, 0.0, 0.0))
    near = OwnClearance(np.nan, why="no robot")
    return Learning(skill, demonstrations, families(demonstrations.points), near, paper, None, None, "asked for", {})


@pytree
class Quadratic:
    A: jax.Array

    def __call__(self, x):
        return 0.5 * x @ self.A @ x


@pytree
class Constant:
    L: jax.Array

    def __call__(self, x):
        return self.L


def test_plane_of_points_in_a_plane(rng):
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    coordinates = rng.normal(size=(4, 30, 2)) * [3.0, 1.0]
    plane = demonstration_plane(coordinates @ axes)
    assert plane.share == pytest.approx(1.0)
    np.testing.assert_allclose(plane.axes @ plane.axes.T, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(plane.project(coordinates @ axes) @ plane.axes, coordinates @ axes, atol=1e-12)
    assert (plane.axes[np.arange(2), np.abs(plane.axes).argmax(1)] > 0).all()
    assert np.ptp(plane.project(coordinates @ axes), axis=(0, 1)).argmax() == 0


def test_plane_share_is_of_distances_from_the_goal():
    x = np.array([[3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
    assert demonstration_plane(x).share == pytest.approx(13 / 14)


def test_plane_needs_points():
    with pytest.raises(ShapeError, match="expected"):
        demonstration_plane(np.zeros((10, 1)))


def test_field_is_evaluated_on_the_plane_and_projected(rng):
    B, L = rng.normal(size=(3, 3)), np.tril(rng.normal(size=(3, 3))) + 3 * np.eye(3)
    A = B @ B.T
    plane = demonstration_plane(rng.normal(size=(20, 3)))
    u, v = np.linspace(-1, 1, 5), np.linspace(0, 2, 4)
    with jax.enable_x64(True):
        field = field_on_plane(Learned(Quadratic(jnp.asarray(A)), Constant(jnp.asarray(L))), plane, u, v)
    assert field.potential.shape == (4, 5) and field.warped.shape == field.descent.shape == (4, 5, 2)
    for j, i in np.ndindex(4, 5):
        x = u[i] * plane.axes[0] + v[j] * plane.axes[1]
        assert field.potential[j, i] == pytest.approx(0.5 * x @ A @ x)
        np.testing.assert_allclose(field.descent[j, i], -plane.axes @ A @ x, atol=1e-12)
        np.testing.assert_allclose(field.warped[j, i], -plane.axes @ np.linalg.solve(L @ L.T, A @ x), atol=1e-12)


def test_fields_follow_the_demonstrations(learning):
    for k in range(2):
        learned = jax.tree.map(lambda a, k=k: a[k], learning.skill.learned)
        subtasks = learning.prepared.subtasks
        plane = demonstration_plane(subtasks.positions[k])
        nominal = subtasks.positions[k, 1, 2:-4:6]
        ways = plane.project(subtasks.directions[k, 1, 2:-4:6])
        for way, (a, b) in zip(ways, plane.project(nominal), strict=True):
            field = field_on_plane(learned, plane, np.array([a]), np.array([b]))
            assert field.descent[0, 0] @ way > 0 and field.warped[0, 0] @ way > 0
        _, descent, warped = fields_at(learned, subtasks.positions[k])
        for field in (descent, warped):
            assert cosines(field, subtasks.directions[k], subtasks.positions[k]).mean() > 0.5
            assert cosines(-field, subtasks.directions[k], subtasks.positions[k]).mean() < -0.5


def test_cosines_leave_out_the_goal():
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert cosines(np.array([[9.0, 9.0], [2.0, 0.0], [3.0, 0.0]]), x + [[1, 0], [0, 0], [0, 0]], x).mean() == 0.5


def test_vector_field_figure(learning):
    figure = vector_field_figure(learning, 1)
    left, right, bar = figure.axes
    assert "potential alone" in left.get_title() and "warped" in right.get_title()
    assert "left/side" in figure.get_suptitle() and "test_skill" in figure.get_suptitle()
    assert "(m)" in left.get_xlabel() and "(m)" in left.get_ylabel() and "(m)" in bar.get_ylabel()
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["demonstrations", "nominal demonstration", "starts", "goal"]
    plane = demonstration_plane(learning.prepared.subtasks.positions[1])
    paths = plane.project(learning.prepared.subtasks.positions[1])
    for axes in (left, right):
        assert axes.get_aspect() == 1.0
        lines = {line.get_label(): line.get_xydata() for line in axes.lines}
        assert len(axes.lines) == 3 + 2
        np.testing.assert_allclose(lines["nominal demonstration"], paths[1])
        np.testing.assert_allclose(lines["goal"], [[0.0, 0.0]])
        (low, high), inside = np.transpose([axes.get_xlim(), axes.get_ylim()]), paths.reshape(-1, 2)
        assert (inside > low).all() and (inside < high).all()


@pytest.mark.parametrize("subtask", [2, -1])
def test_vector_field_of_a_subtask_that_is_not_there(learning, subtask):
    with pytest.raises(UnknownNameError, match="subtask index"):
        vector_field_figure(learning, subtask)


@pytest.mark.parametrize("K", [1, 2, 3, 4])
def test_triangle_figure(K):
    demonstrations = prepared(K)
    figure = triangle_figure(demonstrations, reproduction(demonstrations))
    assert [axes.get_title() for axes in figure.axes] == [f"demonstration {n}: dtw {n + 1}.00 cm" for n in range(3)]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "demonstrated",
        "reproduced",
        "start",
        "goal",
    ]
    for axes, points in zip(figure.axes, demonstrations.points, strict=True):
        assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()) == ("x (m)", "y (m)", "z (m)")
        limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
        size = np.ptp(limits, axis=1)
        np.testing.assert_allclose(axes._box_aspect / axes._box_aspect[0], size / size[0])  # equal scales
        assert (points.min((0, 1)) > limits[:, 0]).all() and (points.max((0, 1)) < limits[:, 1]).all()
        lines = {line.get_label(): np.array(line.get_data_3d()) for line in axes.lines}
        np.testing.assert_allclose(lines["demonstrated"].T, outlines(points))
        np.testing.assert_allclose(lines["start"][:, 0], points[0].mean(0))
        np.testing.assert_allclose(lines["goal"][:, 0], points[-1].mean(0))


def test_outlines_close_only_what_has_an_inside():
    for K, corners in ((1, 1), (2, 2), (3, 4), (4, 5)):
        points = control_points(K)[0]
        line = outlines(points, 5).reshape(5, corners + 1, 3)
        assert np.isnan(line[:, -1]).all() and np.isfinite(line[:, :-1]).all()
        np.testing.assert_allclose(line[[0, -1], :K], points[[0, -1]])
        np.testing.assert_allclose(line[:, 0], line[:, K if K > 2 else 0])


def test_triangles_of_another_skill():
    with pytest.raises(ShapeError, match="Reproduce these demonstrations"):
        triangle_figure(prepared(3), reproduction(prepared(2)))


def test_view_is_across_the_plane_of_the_points(rng):
    points = rng.normal(size=(50, 3)) * [1.0, 0.05, 1.0]
    elevation, azimuth = view_angles(points)
    assert elevation == pytest.approx(20.0) and abs(np.sin(np.radians(azimuth - 20))) == pytest.approx(1.0, abs=0.01)


def test_loss_figure(learning):
    (axes,) = loss_figure(learning).axes
    assert axes.get_yscale() == "log" and axes.get_xlabel() == "update" and "Huber" in axes.get_ylabel()
    assert [line.get_label() for line in axes.lines] == list(NAMES)
    for line, loss in zip(axes.lines, learning.losses.T, strict=True):
        np.testing.assert_allclose(line.get_ydata(), loss)
        np.testing.assert_allclose(line.get_xdata(), np.arange(1, 21))


def test_energy_figure():
    figure = energy_figure(reproduction(prepared(), rise=3e-7))
    left, right = figure.axes
    assert "3.0e-07" in left.get_title() and left.get_yscale() == "log"
    assert left.get_xlabel() == right.get_xlabel() == "time (s)" and "rad/s" in right.get_ylabel()
    assert len(left.lines) == len(right.lines) == 3
    assert left.lines[0].get_ydata()[0] == pytest.approx(1.0)
    np.testing.assert_allclose(right.lines[0].get_ydata(), np.sqrt(7) * np.exp(-np.linspace(0.0, 2.0, 21)))


def test_relative_energy_of_rest():
    np.testing.assert_array_equal(relative_energy(np.array([[2.0, 2.0], [3.0, 1.0]])), [[0.0, 0.0], [1.0, 0.0]])


def test_width_figure(learning):
    figure = width_figure(learning)
    cosine, beyond, basin = figure.axes
    assert all(axes.get_xlabel() == "kernel width (cm)" for axes in figure.axes)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [*NAMES, "could not be fitted", "chosen"]
    lines = {line.get_label(): line.get_xydata() for line in cosine.lines}
    np.testing.assert_allclose(lines["tip"], [[3.0, np.nan], [5.0, 0.9], [8.0, 0.8]])
    np.testing.assert_allclose(lines["could not be fitted"][:, 0], [3.0, 3.0])
    stars = [line.get_xydata() for line in cosine.lines if line.get_marker() == "*" and len(line.get_xydata())]
    np.testing.assert_allclose(stars, [[[5.0, 0.9]]] * 2)
    np.testing.assert_allclose(beyond.lines[0].get_ydata(), [np.nan, 1.0, 5.0])
    heights = np.array([bar.get_height() for bar in basin.patches]).reshape(2, 3)
    np.testing.assert_allclose(heights, [[np.nan, 100.0, np.nan]] * 2)


def test_saved_figures(learning, tmp_path):
    folder = tmp_path / "new" / "figures"
    paths = save_learning_figures(learning, folder)
    paths += save_reproduction_figures(learning.prepared, reproduction(learning.prepared), folder)
    names = ["vector_field_0_tip.png", "vector_field_1_left_side.png", "kernel_width.png", "loss.png"]
    assert [path.name for path in paths] == [*names, "triangles.png", "energy.png"]
    assert sorted(folder.iterdir()) == sorted(paths)  # nothing temporary is left
    from matplotlib.image import imread

    for path in paths:
        picture = imread(path)
        assert picture.shape[0] > 400 and picture.shape[1] > 700 and picture.std() > 0.02


def test_no_global_state(learning):
    before = "matplotlib.pyplot" in sys.modules
    loss_figure(learning)
    assert ("matplotlib.pyplot" in sys.modules) == before


def test_without_matplotlib(learning, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependencyError, match=r"matplotlib is needed.*jaxrmp\[plots\]"):
        loss_figure(learning)
