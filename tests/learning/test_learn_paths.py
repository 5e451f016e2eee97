"""Policies from paths of a point alone: in any unit, of paths that cross, and what is refused."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, DemonstrationError, FileWarning, certificate
from jaxrmp.learning import FlowSettings, _learn_paths, learn_paths
from jaxrmp.learning._flow_training import check_stretch
from jaxrmp.simulation import rollout

FEW = FlowSettings(updates=200, couplings=6, hidden=16)
S = np.linspace(0, 1, 80)[:, None]
ARC = np.hstack([300 * S, 90 * np.sin(4 * S)])  # pixels
ARCS = [ARC + [40, 7 * k] + (1 - S) * [0, 4 * k] for k in range(3)]
LOOP = np.hstack([200 * S + 90 * np.sin(2 * np.pi * S), 90 * np.cos(2 * np.pi * S)])


@pytest.fixture(scope="module")
def arcs():
    return learn_paths(ARCS, FEW)


def test_a_policy_in_pixels_follows_the_paths_and_is_certified(arcs):
    assert arcs.lift is None
    np.testing.assert_allclose(arcs.goal, np.mean([path[-1] for path in ARCS], axis=0))
    assert arcs.mean["frechet"] < 15
    path = rollout(arcs.policy, jnp.asarray(arcs.start([0.0, 150.0]), jnp.float32), duration=15.0)
    np.testing.assert_allclose(path.q[-1], arcs.goal, atol=1.0)
    with jax.enable_x64(True):
        assert certificate(arcs.policy, jnp.array([120.0, 60.0]), jnp.array([30.0, -20.0])).residual < 1e-8


def test_units_and_speed_change_nothing_but_the_scale(arcs):
    found = learn_paths([path / 1000 for path in ARCS], FEW, speed=0.5)
    np.testing.assert_allclose(1000 * found.mean["frechet"], arcs.mean["frechet"], rtol=0.1)
    np.testing.assert_allclose(1000 * found.reproductions[:, -1], arcs.reproductions[:, -1], atol=0.1)
    assert found.dt < arcs.dt


def test_a_path_that_crosses_itself_gets_the_length_left_as_a_coordinate():
    with pytest.warns(FileWarning, match="paths 0 and 0 cross near"):
        found = learn_paths([LOOP], replace(FEW, updates=600))
    assert found.start([[0.0, 0.0], [1.0, 1.0]]).shape == (2, 3)
    assert found.reproductions.shape[-1] == 2
    assert found.mean["frechet"] < 25  # the loop is 180 wide
    np.testing.assert_allclose(found.reproductions[0, -1], found.goal, atol=1.0)


def test_paths_that_go_two_ways_are_told():
    ways = [np.hstack([300 * S, (90 + 5 * k) * side * np.sin(np.pi * S)]) for side in (-1, 1) for k in range(3)]
    with pytest.warns(FileWarning, match="paths go several ways .* part by"):
        learn_paths(ways, replace(FEW, updates=20, conditioning=1.0))


@pytest.mark.parametrize(
    ("paths", "message"),
    [
        ([], "no paths"),
        ([np.zeros(5)], r"path 0 has shape \(5,\)"),
        ([ARC, np.hstack([ARC, S])], "path 1 is in 3 dimensions, path 0 in 2"),
        ([np.where(ARC > 299, np.nan, ARC)], "path 0 is not finite at sample 79"),
        ([ARC, np.vstack([ARC, ARC[::-1]])], "path 1 ends where it began"),
        ([[["a", "b"]] * 3], "path 0 is not an array of numbers"),
    ],
)
def test_what_is_no_path_is_refused(paths, message):
    with pytest.raises(DemonstrationError, match=message):
        learn_paths(paths, FEW)


def test_a_speed_that_is_none_is_refused():
    with pytest.raises(ConfigurationError, match="speed is -1"):
        learn_paths(ARCS, FEW, speed=-1.0)


def test_paths_of_which_no_flow_of_the_place_passes_get_the_coordinate_too(monkeypatch):
    """The check as it is, told that flows of the plane stretch: which of them do by themselves hangs on rounding."""

    def check(fit):
        check_stretch(fit._replace(stretch=(0.0, 99.0)) if fit.flow.back.shape[-1] == 2 else fit)

    monkeypatch.setattr(_learn_paths, "check_stretch", check)
    with pytest.warns(FileWarning, match="no flow of the place alone passes: the flow stretches"):
        found = learn_paths(ARCS, FEW)
    assert found.lift is not None
    assert found.start(ARCS[0][0]).shape == (3,)
