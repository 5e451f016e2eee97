"""The basin check on potentials whose minima are known."""

import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial

from jaxrmp.learning._basin import check_basin

BOX = (np.full(3, -0.2), np.full(3, 0.2))


def two_wells(other, x):
    """A well at the origin and an equal one at `other`; the plane half-way parts their basins."""
    return -jnp.logaddexp(-jnp.sum(x * x) / 0.02, -jnp.sum((x - other) ** 2) / 0.02)


def test_one_minimum_is_reached_from_everywhere():
    scale = jnp.asarray([1.0, 3.0, 0.5])
    basin = check_basin(Partial(lambda scale, x: jnp.sum(scale * x * x), scale), *BOX, starts=300)
    assert basin.starts == 300
    assert basin.share_reached == 1.0
    assert basin.rest_points == ()


def test_a_second_minimum_is_found_where_it_is_with_its_share():
    other = jnp.asarray([0.4, 0.0, 0.0])
    basin = check_basin(Partial(two_wells, other), *BOX, starts=2000, margin=0.3)
    # The box is [-0.5, 0.5]^3, parted at x = 0.2; 4 standard deviations of a share of 2,000 draws.
    np.testing.assert_allclose(basin.share_reached, 0.7, atol=4 * np.sqrt(0.7 * 0.3 / 2000))
    ((position, share),) = basin.rest_points
    np.testing.assert_allclose(position, other, atol=0.005)
    np.testing.assert_allclose(share + basin.share_reached, 1.0)


def test_several_rest_points_come_most_visited_first():
    def three_wells(x):
        square = [
            jnp.sum((x - c) ** 2) / 0.02
            for c in (jnp.zeros(3), jnp.asarray([0.0, 0.3, 0]), jnp.asarray([0.0, -0.8, 0]))
        ]
        return -jnp.logaddexp(jnp.logaddexp(-square[0], -square[1]), -square[2])

    basin = check_basin(Partial(three_wells), *BOX, starts=1000, margin=0.3, seed=1)
    positions = [p for p, _ in basin.rest_points]
    np.testing.assert_allclose(positions, [[0, 0.3, 0], [0, -0.8, 0]], atol=0.01)
    # y is parted at 0.15 and -0.4 in a box that reaches from -0.5 to 0.5.
    np.testing.assert_allclose([share for _, share in basin.rest_points], [0.35, 0.1], atol=4 * np.sqrt(0.25 / 1000))


def test_a_potential_without_a_minimum_or_with_nan_reaches_nothing():
    slope = Partial(jnp.sum)
    assert check_basin(slope, *BOX, starts=100).share_reached == 0.0
    broken = check_basin(Partial(lambda x: jnp.sum(jnp.sqrt(x))), *BOX, starts=100)
    assert broken.share_reached == 0.0


def test_the_starts_depend_on_the_seed_alone():
    wells = Partial(two_wells, jnp.asarray([0.4, 0.0, 0.0]))
    first, again, other = (check_basin(wells, *BOX, starts=500, seed=s) for s in (0, 0, 1))
    assert first == again
    assert first.share_reached != other.share_reached
