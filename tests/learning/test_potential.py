"""The convex program of the potential against finite differences, an independent solver, and known answers."""

import jax
import numpy as np
import pytest
from scipy.optimize import nnls

from jaxrmp import ConfigurationError, ConvexProgramError, DemonstrationError
from jaxrmp.learning._potential_program import fit_potential, slope_map

ETA = 30.0


def arc(T=40, m=3):
    t = np.linspace(1, 0, T)[:, None]
    points = 0.3 * np.concatenate([np.sin(1.5 * t), 1 - np.cos(1.5 * t), t * (1 - t)], axis=1)[:, :m]
    v = np.gradient(points, axis=0)
    return points, v / np.linalg.norm(v, axis=1, keepdims=True)


def line(T=40):
    points = np.linspace(1, 0, T)[:, None] * [0.4, 0.1, 0.05]
    direction = -points[0] / np.linalg.norm(points[0])
    return points, np.broadcast_to(direction, points.shape) * np.tanh(np.linalg.norm(points, axis=1) / 0.03)[:, None]


def slopes_by_definition(points, biases, width):
    """grad Phi at the points, from equations 4 to 6 differentiated by hand, kernel by kernel."""
    slopes = []
    for x in points:
        d = x - points
        r = np.linalg.norm(d, axis=1)
        w = np.exp(-(r**2) / (2 * width**2))
        w /= w.sum()
        phi = np.logaddexp(ETA * r, -ETA * r) / ETA + biases
        unit = np.divide(d, r[:, None], out=np.zeros_like(d), where=r[:, None] > 0)
        dw = w[:, None] * (-d + w @ d) / width**2
        slopes.append(w @ (np.tanh(ETA * r)[:, None] * unit) + phi @ dw)
    return np.asarray(slopes)


@pytest.mark.parametrize("width", [0.03, 0.1])
def test_the_slope_is_affine_in_the_biases_with_the_map_returned(width):
    points, _ = arc()
    with jax.enable_x64(True):
        A, c = (np.asarray(a) for a in slope_map(points, width, ETA))
    np.testing.assert_allclose(c, slopes_by_definition(points, np.zeros(len(points)), width), atol=1e-11)
    biases = np.random.default_rng(0).uniform(0, 1, len(points))
    np.testing.assert_allclose(A @ biases + c, slopes_by_definition(points, biases, width), rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("width", [0.03, 0.1, 0.3])
def test_the_program_is_solved_as_by_an_independent_solver(width):
    """The biases are ill-conditioned, so objectives and slopes are compared, not biases."""
    points, directions = arc()
    T, regularization, end_weight = len(points), 1e-4, 100.0
    fit = fit_potential(points, directions, width)
    c = slopes_by_definition(points, np.zeros(T), width)
    A = np.stack([slopes_by_definition(points, e, width) - c for e in np.eye(T)], axis=-1)

    def objective(biases):
        error = directions + A @ biases + c
        end = A[-1] @ biases + c[-1]
        return np.mean(np.sum(error**2, axis=1)) + regularization * biases @ biases + end_weight * end @ end

    # Falling biases that end at or above zero: sums of non-negative steps.
    sums = np.triu(np.ones((T, T)))
    rows = [A.reshape(-1, T) / np.sqrt(T), np.sqrt(end_weight) * A[-1], np.sqrt(regularization) * np.eye(T)]
    target = [-(directions + c).ravel() / np.sqrt(T), -np.sqrt(end_weight) * c[-1], np.zeros(T)]
    expected = sums @ nnls(np.concatenate(rows) @ sums, np.concatenate(target))[0]

    biases = np.asarray(fit.potential.biases, float)
    assert fit.status == "optimal"
    assert (biases >= 0).all() and (np.diff(biases) <= 0).all()
    np.testing.assert_allclose(fit.objective, objective(expected), rtol=1e-5)
    np.testing.assert_allclose(objective(biases), objective(expected), rtol=1e-4)
    np.testing.assert_allclose(A @ biases + c, A @ expected + c, atol=2e-3)
    rms = np.sqrt(np.mean(np.sum((directions + A @ expected + c) ** 2, axis=1)))
    np.testing.assert_allclose(fit.direction_rms, rms, rtol=1e-3)
    np.testing.assert_allclose(fit.end_slope, np.linalg.norm(A[-1] @ expected + c[-1]), atol=1e-4)


def test_a_straight_line_is_followed_nearly_exactly_and_ends_in_a_minimum():
    points, directions = line()
    with jax.enable_x64(True):
        fit = fit_potential(points, directions, 0.03)
        slopes = np.asarray(jax.jit(jax.vmap(jax.grad(fit.potential)))(points))
    assert fit.direction_rms < 0.03
    inside = slice(3, -10)  # where kernels reach past neither end
    assert np.linalg.norm(slopes + directions, axis=1)[inside].max() < 0.05
    assert np.abs(slopes[-1]).max() < 1e-12  # the correction cancels the slope at the end exactly
    assert len(fit.goal_hessian_eigenvalues) == 3
    assert min(fit.goal_hessian_eigenvalues) > 10


def test_the_end_is_stationary_in_single_precision_too():
    points, directions = arc()
    fit = fit_potential(points, directions, 0.05)
    slope = jax.jit(jax.grad(fit.potential))(np.asarray(points[-1], np.float32))
    assert np.abs(slope).max() < 1e-4  # rounding of points / width^2 in float32
    assert min(fit.goal_hessian_eigenvalues) > 0


def test_the_goal_hessian_agrees_with_differences_of_the_slope():
    points, directions = arc()
    with jax.enable_x64(True):
        fit = fit_potential(points, directions, 0.1)
        slope = jax.jit(jax.grad(fit.potential))
        h = 1e-6
        H = np.stack([(slope(points[-1] + h * e) - slope(points[-1] - h * e)) / (2 * h) for e in np.eye(3)])
    np.testing.assert_allclose(fit.goal_hessian_eigenvalues, np.linalg.eigvalsh((H + H.T) / 2), rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p, v: (p[:2], v[:2]), r"T >= 3, received \(2, 3\)"),
        (lambda p, v: (p, v[:-1]), r"received \(40, 3\) and \(39, 3\)"),
        (lambda p, v: (p[:, 0], v[:, 0]), r"must both be \[T, m\]"),
        (lambda p, v: (np.where(p == p[4], np.nan, p), v), "non-finite"),
        (lambda p, v: (p, np.where(v == v[4], np.inf, v)), "non-finite"),
    ],
)
def test_what_is_no_trajectory_is_refused(change, message):
    with pytest.raises(DemonstrationError, match=message):
        fit_potential(*change(*arc()), 0.05)


def test_a_status_other_than_optimal_is_an_error():
    points, directions = arc()
    with pytest.raises(ConvexProgramError, match="status '.*' at kernel width 0.05 m, not 'optimal'"):
        fit_potential(points, 1e150 * directions, 0.05)  # so large that the solver gives up


def test_a_goal_that_is_no_minimum_is_an_error():
    """A jagged walk, one of a few per cent whose best potential has a saddle at its end."""
    rng = np.random.default_rng(0)
    for draw in range(60):
        points = np.cumsum(rng.normal(scale=0.03, size=(12, 2)), 0)
        points -= points[-1]
        directions = rng.normal(size=(12, 2)) if draw % 2 else np.gradient(points, axis=0)
        if draw == 5:
            break
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    with pytest.raises(ConvexProgramError, match=r"no minimum at the goal: its Hessian there has eigenvalues \(-"):
        fit_potential(points, directions, 0.05)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"width": 0.0}, "width is 0.0, expected a positive number"),
        ({"width": float("nan")}, "width is nan"),
        ({"width": 0.05, "sharpness": float("inf")}, "sharpness is inf"),
        ({"width": 0.05, "end_weight": -1.0}, "end_weight is -1.0"),
        ({"width": 0.05, "regularization": -1e-3}, "regularization is -0.001, expected a number that is not negative"),
    ],
)
def test_settings_out_of_range_are_named(settings, message):
    with pytest.raises(ConfigurationError, match=message):
        fit_potential(*arc(), **settings)
