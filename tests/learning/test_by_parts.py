"""Any number of samples by a program for some."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp.learning._by_parts import by_parts


@pytest.mark.parametrize("samples", [1, 3, 4, 5, 9])
def test_parts_give_what_the_whole_gives(samples):
    x = np.random.default_rng(0).normal(size=(samples, 2, 3))
    shapes = set()

    def program(x):
        shapes.add(x.shape)
        return jnp.sin(x), jax.vmap(jnp.sum)(x)

    sines, sums = by_parts(program, x, 4)
    assert shapes == {(4, 2, 3)} and sines.dtype == np.float64
    np.testing.assert_allclose(sines, np.sin(x), rtol=1e-12)
    np.testing.assert_allclose(sums, x.sum((1, 2)), rtol=1e-12)
