"""The picture of an inspection: what it shows of small values made by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ShapeError, compose, pullback
from jaxrmp.inspection import inspect
from jaxrmp.leaves import Attractor, Damping, JointLimit
from jaxrmp.simulation import rollout

figures = pytest.importorskip("jaxrmp.visualization", reason="needs matplotlib: pip install 'jaxrmp[plots]'")


@pytest.fixture(scope="module")
def rolled():
    tree = Attractor(jnp.asarray([1.0, 0.5])) + Damping(1.0, 0.5) + JointLimit(-2 * jnp.ones(2), 2 * jnp.ones(2))
    path = jax.jit(lambda q: rollout(tree, q, duration=4.0, dt=0.05))(jnp.asarray([-1.0, 0.3]))
    return path, jax.jit(jax.vmap(inspect, (None, 0, 0)))(tree, path.q, path.qd)


def test_it_shows_shares_gaps_and_energies(rolled):
    path, found = rolled
    figure = figures.inspection_figure(found, path.time)
    forces, metrics, gaps, energies = figure.axes
    assert figure.legends[0].get_texts()[0].get_text() == "attractor"
    assert len(forces.collections) == len(metrics.collections) == len(found.names) == 3
    np.testing.assert_allclose(energies.lines[-1].get_ydata(), path.energy, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(gaps.lines[0].get_ydata(), found.gap[:, 0], rtol=1e-6)
    top = forces.collections[-1].get_paths()[0].vertices[:, 1].max()
    assert top == pytest.approx(100, abs=1e-3)


def test_the_rest_is_shown_as_one_and_marked(rolled):
    path, found = rolled
    figure = figures.inspection_figure(found, path.time, rows=1)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["attractor", "2 more"]
    tree = pullback(compose(), Damping()) + Damping(2.0)
    single = jax.vmap(lambda q: inspect(tree, q, q))(path.q[:1])
    figures.inspection_figure(single, path.time[:1])


def test_shapes_that_do_not_fit_are_refused(rolled):
    path, found = rolled
    with pytest.raises(ShapeError, match=r"time has shape \(80,\).*leading axes \(81,\)"):
        figures.inspection_figure(found, path.time[1:])
    with pytest.raises(ShapeError, match=r"leading axes \(\)"):
        figures.inspection_figure(jax.tree.map(lambda a: a[0], found), path.time)
