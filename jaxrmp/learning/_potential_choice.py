"""Chooses the potential's kernel width: clean basin first, then the best alignment with all demonstrations."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import BasinError, ConvexProgramError
from ._basin import Basin, check_basin
from ._potential_program import PotentialFit, fit_potential


class WidthTrial(NamedTuple):
    """One kernel width tried, m: `problem` says why the fit failed (empty if not); `alignment`, the mean cosine between
    `-grad Phi` and the demonstrated directions over all demonstrations; `beyond_90`, the share of samples where it is
    negative, which no metric can turn; `basin`, measured only for widths that were the best so far."""

    width: float
    problem: str
    alignment: float
    beyond_90: float
    basin: Basin | None


class PotentialChoice(NamedTuple):
    """The chosen `fit`, its `trial`, and all `trials` in the order of the widths."""

    fit: PotentialFit
    trial: WidthTrial
    trials: tuple[WidthTrial, ...]


def choose_potential(
    positions: np.ndarray,
    directions: np.ndarray,
    nominal: int,
    *,
    widths: tuple[float, ...],
    basin_starts: int = 2000,
    basin_margin: float = 0.3,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **fit: float,
) -> PotentialChoice:
    """Fit the potential with each kernel width and keep the best one whose basin is clean.

    Best is the greatest mean cosine between `-grad Phi` and the directions of all N demonstrations, of which only the
    nominal one was fitted: the others validate. Clean means that descent from every one of `basin_starts` random
    starts in the demonstrations' box grown by `basin_margin` ends at the goal.

    **Arguments**: `positions` [N, T, m], m, goal at the origin; `directions` [N, T, m], unit; `nominal`, the index of
    the nominal demonstration; `widths`, m; `progress`, called with the fraction done; `fit`, the arguments by name of
    `fit_potential`; the rest as in `check_basin`: `basin_starts`, `basin_margin`, m, and `seed`.
    **Returns** a `PotentialChoice`.
    **Raises** `ConvexProgramError` if no width could be fitted, `BasinError` if none has a clean basin.
    """
    fits: dict[float, PotentialFit] = {}
    trials: dict[float, WidthTrial] = {}
    for i, width in enumerate(widths):
        if progress is not None:
            progress(i / (len(widths) + 2))  # a check of the basin takes about as long as two fits
        try:
            fits[width] = fit_potential(positions[nominal], directions[nominal], width, **fit)
        except ConvexProgramError as error:
            trials[width] = WidthTrial(width, str(error), float("nan"), float("nan"), None)
            continue
        cosines = alignment(fits[width], positions, directions)
        trials[width] = WidthTrial(width, "", float(cosines.mean()), float((cosines < 0).mean()), None)
    if not fits:
        raise ConvexProgramError(f"no kernel width could be fitted. {trials[widths[-1]].problem}")
    box = positions.reshape(-1, positions.shape[-1])
    for width in sorted(fits, key=lambda width: -trials[width].alignment):
        potential = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), fits[width].potential)
        basin = check_basin(potential, box.min(0), box.max(0), starts=basin_starts, margin=basin_margin, seed=seed)
        trials[width] = trials[width]._replace(basin=basin)
        if basin.share_reached == 1.0:
            return PotentialChoice(fits[width], trials[width], tuple(trials[w] for w in widths))
    found = ", ".join(f"{w} m: {trials[w].basin.share_reached:.1%}" for w in fits)  # type: ignore[union-attr]
    raise BasinError(
        f"no kernel width gives a potential without spurious attractors; share of starts that reach the goal: {found}. "
        "Try narrower widths, or a smaller basin_margin if the skill is never started that far away."
    )


def alignment(fit: PotentialFit, positions: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Cosines [S] between `-grad Phi` and `directions` at all samples but those at the goal, where there is none."""
    x = positions.reshape(-1, positions.shape[-1])
    slope = np.asarray(_slopes(fit.potential, jnp.asarray(x, jnp.float32)), float)
    return cosines(-slope, directions.reshape(x.shape), x)


def cosines(field: np.ndarray, directions: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Cosines between `field` and unit `directions` [..., m] at all `positions` but those at the goal."""
    away = np.linalg.norm(positions, axis=-1) > 1e-4
    return (field * directions).sum(-1)[away] / np.maximum(np.linalg.norm(field, axis=-1)[away], 1e-12)


_slopes = jax.jit(lambda potential, x: jax.vmap(jax.grad(potential))(x))
