"""The convex program that fits the potential's biases to the nominal demonstration."""

import math
import warnings
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, ConvexProgramError, DemonstrationError, importing
from ..leaves import NominalPotential


class PotentialFit(NamedTuple):
    """A fitted `potential` and how it was fitted.

    `status`, the solver's; `objective`, its value; `direction_rms`, root mean square of `v_t + grad Phi(z_t)` over
    the nominal points; `end_slope`, slope at the end before its correction; `goal_hessian_eigenvalues` [m], 1/m.
    """

    potential: NominalPotential
    status: str
    objective: float
    direction_rms: float
    end_slope: float
    goal_hessian_eigenvalues: tuple[float, ...]


@jax.jit
def slope_map(points: jax.Array, width: jax.Array, sharpness: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The potential's gradient at its own nominal points as an affine map of the biases.

    **Returns** `A` [T, m, T] and `c` [T, m] with `grad Phi(z_s) = A_s biases + c_s`.
    """

    def slopes(biases):
        potential = NominalPotential(points, biases, jnp.zeros(points.shape[1]), width, sharpness)
        return jax.vmap(jax.grad(potential))(points)

    zero = jnp.zeros(len(points))
    return jax.jacfwd(slopes)(zero), slopes(zero)


def fit_potential(
    points: np.ndarray,
    directions: np.ndarray,
    width: float,
    *,
    sharpness: float = 30.0,
    regularization: float = 1e-4,
    end_weight: float = 100.0,
) -> PotentialFit:
    """Fit the potential along one nominal trajectory so that its negative gradient points along the motion.

    Minimises `1/T sum_t |v_t + grad Phi(z_t)|^2 + regularization |biases|^2 + end_weight |grad Phi(z_T)|^2` subject to
    `0 <= bias_T <= bias_{t+1} <= bias_t`, then cancels the slope left at the end exactly. The published program asks
    for a zero slope at the end as a constraint, which together with the ordered biases has no solution on most
    recorded data.

    **Arguments**: `points` [T, m], metres, ending at the origin; `directions` v [T, m], unit vectors (or shorter near
    the end); `width`, kernel width, metres; `sharpness`, 1/m; `regularization` and `end_weight`, as above.
    **Returns** a `PotentialFit`.
    **Raises** `DemonstrationError` for shapes or numbers that make no trajectory; `ConfigurationError` for settings out
    of range; `ConvexProgramError` if the solver's status is anything but optimal, or the goal is not a strict minimum.

    Rana et al. 2019, equation 7.
    """
    with importing("cvxpy", "learning"):
        import cvxpy
    points, directions = np.asarray(points, float), np.asarray(directions, float)
    if points.ndim != 2 or points.shape != directions.shape or len(points) < 3:
        raise DemonstrationError(
            f"points and directions must both be [T, m] with T >= 3, received {points.shape} and {directions.shape}."
        )
    for name, value in (("width", width), ("sharpness", sharpness), ("end_weight", end_weight)):
        if not 0 < value < math.inf:
            raise ConfigurationError(f"{name} is {value!r}, expected a positive number.")
    if not 0 <= regularization < math.inf:
        raise ConfigurationError(f"regularization is {regularization!r}, expected a number that is not negative.")
    if not (np.isfinite(points).all() and np.isfinite(directions).all()):
        raise DemonstrationError("points or directions hold non-finite numbers.")
    T, m = points.shape
    with jax.enable_x64(True):
        A, c = (np.asarray(a) for a in slope_map(points, width, sharpness))
    rows = np.concatenate([A.reshape(T * m, T) / math.sqrt(T), math.sqrt(end_weight) * A[-1]])
    target = np.concatenate([-(directions + c).reshape(-1) / math.sqrt(T), -math.sqrt(end_weight) * c[-1]])
    # Bias steps instead of biases turn the ordering into plain signs: bias_t = sum_{s >= t} step_s, step >= 0.
    cumulate = np.triu(np.ones((T, T)))
    rows_of_steps = rows @ cumulate
    P = rows_of_steps.T @ rows_of_steps + regularization * cumulate.T @ cumulate
    steps = cvxpy.Variable(T, nonneg=True)
    objective = cvxpy.quad_form(steps, cvxpy.psd_wrap(P)) - 2 * (rows_of_steps.T @ target) @ steps
    problem = cvxpy.Problem(cvxpy.Minimize(objective))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # cvxpy warns of what the status below turns into an error
        try:
            problem.solve(solver=cvxpy.CLARABEL)
            status = problem.status
        except cvxpy.SolverError as error:
            status = f"solver_error ({error})"
    if status != cvxpy.OPTIMAL:
        raise ConvexProgramError(
            f"the potential's convex program ended with status {status!r} at kernel width {width} m, not 'optimal'. "
            "Try another kernel width, or check the nominal demonstration for jumps."
        )
    biases = cumulate @ np.maximum(np.asarray(steps.value), 0)
    slopes = A @ biases + c
    parameters = (points, biases, slopes[-1], width, sharpness)
    with jax.enable_x64(True):
        H = _hessian(NominalPotential(*(jnp.asarray(a, float) for a in parameters)), points[-1])
    eigenvalues = tuple(np.linalg.eigvalsh(np.asarray(H)).tolist())
    if not eigenvalues[0] > 0:
        raise ConvexProgramError(
            f"the fitted potential has no minimum at the goal: its Hessian there has eigenvalues {eigenvalues}. Try "
            "another kernel width."
        )
    return PotentialFit(
        NominalPotential(*map(jnp.asarray, parameters)),
        status,
        float(problem.value + target @ target),
        float(np.sqrt(np.mean(np.sum((directions + slopes) ** 2, axis=-1)))),
        float(np.linalg.norm(slopes[-1])),
        eigenvalues,
    )


_hessian = jax.jit(lambda potential, x: jax.hessian(potential)(x))
