"""Measures and the choice of the nominal demonstration, against small answers and independent implementations."""

from functools import cache

import numpy as np
import pytest

from jaxrmp import DemonstrationError, ShapeError
from jaxrmp.learning._measures import discrete_frechet, dtw_distance, reproduction_errors
from jaxrmp.learning._nominal import nominal_demonstration

LINE = np.stack([np.linspace(0.0, 1.0, 5), np.zeros(5)], axis=1)


def walk(rng, samples, m=3):
    return np.cumsum(rng.normal(size=(samples, m)), axis=0)


def frechet_by_definition(a, b):
    @cache
    def leash(i, j):
        here = float(np.linalg.norm(a[i] - b[j]))
        before = [leash(*p) for p in ((i - 1, j - 1), (i - 1, j), (i, j - 1)) if min(p) >= 0]
        return max(here, min(before)) if before else here

    return leash(len(a) - 1, len(b) - 1)


def dtw_by_definition(a, b):
    """The least sum over all alignments, cell by cell, and how many pairs it has."""
    cells = {}
    for i, j in np.ndindex(len(a), len(b)):
        before = [cells[p] for p in ((i - 1, j - 1), (i - 1, j), (i, j - 1)) if p in cells]
        total, pairs = min(before, key=lambda cell: cell[0], default=(0.0, 0))
        cells[i, j] = total + float(np.linalg.norm(a[i] - b[j])), pairs + 1
    return cells[len(a) - 1, len(b) - 1]


@pytest.mark.parametrize("measure", [dtw_distance, discrete_frechet])
def test_small_answers(measure):
    assert measure(LINE, LINE) == 0.0
    assert measure(LINE, np.repeat(LINE, 3, axis=0)) == 0.0
    assert measure(LINE, LINE + [0.0, 2.0]) == pytest.approx(2.0)
    assert measure(LINE[:1], LINE[-1:]) == pytest.approx(1.0)


def test_one_point_against_many():
    assert discrete_frechet(LINE[:1], LINE) == pytest.approx(1.0)
    assert dtw_distance(LINE[:1], LINE) == pytest.approx(0.5)  # (0 + 1/4 + 1/2 + 3/4 + 1) / 5


def test_a_single_outlier_counts_fully_in_frechet_and_little_in_dtw():
    bumped = LINE.copy()
    bumped[2, 1] = 1.0
    assert discrete_frechet(LINE, bumped) == pytest.approx(1.0)
    assert dtw_distance(LINE, bumped) == pytest.approx(0.2)


def test_dtw_agrees_with_its_definition():
    rng = np.random.default_rng(0)
    for samples in (1, 2, 7, 60):
        a, b = walk(rng, samples), walk(rng, 40)
        total, pairs = dtw_by_definition(a, b)
        assert dtw_distance(a, b) == pytest.approx(total / pairs, rel=1e-12)
        assert dtw_distance(b, a) == pytest.approx(dtw_distance(a, b), rel=1e-12)


def test_frechet_agrees_with_its_definition():
    rng = np.random.default_rng(1)
    for samples in (1, 2, 5, 9):
        a, b = walk(rng, samples), walk(rng, 6)
        assert discrete_frechet(a, b) == frechet_by_definition(a, b)


@pytest.mark.parametrize("measure", [dtw_distance, discrete_frechet])
def test_paths_that_do_not_fit_are_refused(measure):
    for a, b in [(LINE, np.zeros((4, 3))), (LINE, np.zeros((0, 2))), (LINE, np.zeros(5))]:
        with pytest.raises(ShapeError, match="expected"):
            measure(a, b)


def test_reproduction_errors_do_not_see_speed():
    s = np.linspace(0.0, 1.0, 300)
    path = lambda s: np.stack([[s, s**2, 0 * s], [s, 0 * s, s]]).transpose(2, 0, 1)  # noqa: E731
    same = reproduction_errors(path(s), path(s**3))
    assert max(same.values()) < 0.01
    aside = reproduction_errors(path(s), path(s) + [[0.0, 0.0, 0.0], [0.0, 0.02, 0.0]])
    assert aside["goal_cm"] == pytest.approx(1.0)
    assert aside["frechet_cm"] == pytest.approx(1.0)
    assert aside["dtw_cm"] == pytest.approx(1.0)


def test_reproduction_errors_check_their_points():
    with pytest.raises(ShapeError, match=r"\[T, K, 3\]"):
        reproduction_errors(np.zeros((5, 3, 3)), np.zeros((5, 2, 3)))


def test_the_nominal_demonstration_is_the_one_in_the_middle():
    paths = [LINE + [0.0, height] for height in (0.0, 1.0, 0.4)]
    index, distances = nominal_demonstration(paths)
    assert index == 2
    np.testing.assert_allclose(distances, distances.T)
    assert distances[0, 1] == pytest.approx(5.0)
    assert (np.diag(distances) == 0).all()


def test_the_nominal_demonstration_needs_comparable_ones():
    with pytest.raises(DemonstrationError, match="at least two"):
        nominal_demonstration([LINE])
    with pytest.raises(ShapeError, match="with one m"):
        nominal_demonstration([LINE, np.zeros((5, 3))])


def test_the_distances_are_those_of_all_pairs_of_paths_of_any_lengths():
    rng = np.random.default_rng(2)
    paths = [walk(rng, samples) for samples in (30, 17, 1, 41)]
    index, distances = nominal_demonstration(paths)
    expected = [[dtw_by_definition(a, b)[0] if a is not b else 0.0 for b in paths] for a in paths]
    np.testing.assert_allclose(distances, expected, rtol=1e-12)
    assert index == np.argmin(np.sum(expected, axis=1))


def test_the_distances_are_those_of_dtaidistance():
    """Of version 2.5.1, `dtw_ndim.distance_fast(inner_dist="euclidean")`, which this replaces."""
    rng = np.random.default_rng(0)
    _, distances = nominal_demonstration([walk(rng, 200) for _ in range(6)])
    assert distances[0, 1] == pytest.approx(4332.6924916447415, rel=1e-13)
    assert distances.sum() == pytest.approx(156862.3756631859, rel=1e-13)
