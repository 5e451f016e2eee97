"""Natural and canonical forms, their sum, and the step from force to acceleration."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import CanonicalForm, DiagonalForm, NaturalForm, ShapeError, UnknownNameError, canonical, natural, resolve

pytestmark = pytest.mark.usefixtures("x64")


def random_form(seed, shape=(), m=4):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(*shape, m, m))
    M = root @ np.swapaxes(root, -1, -2) + np.eye(m)
    return NaturalForm(jnp.asarray(rng.normal(size=(*shape, m))), jnp.asarray(M))


def test_natural_forms_add_force_to_force_and_metric_to_metric():
    a, b = random_form(0), random_form(1)
    total = a + b
    np.testing.assert_array_equal(total.f, a.f + b.f)
    np.testing.assert_array_equal(total.M, a.M + b.M)


def test_accelerations_do_not_add():
    form = canonical(random_form(0))
    with pytest.raises(TypeError, match="unsupported operand"):
        form + form  # type: ignore[operator]
    with pytest.raises(TypeError, match="unsupported operand"):
        random_form(0) + form  # type: ignore[operator]


def test_forms_of_different_spaces_do_not_add():
    with pytest.raises(ShapeError, match=r"\(4,\) and \(3,\).*Pull both back"):
        random_form(0) + random_form(1, m=3)
    with pytest.raises(ShapeError, match=r"\(2, 3\) and \(3,\)"):
        random_form(0, (2,), 3) + random_form(1, m=3)


@pytest.mark.parametrize("shape", [(), (5,)])
def test_round_trip_between_the_forms(shape):
    form = random_form(2, shape)
    there = canonical(form)
    assert isinstance(there, CanonicalForm)
    np.testing.assert_allclose(jnp.einsum("...ij,...j->...i", there.M, there.a), form.f, rtol=1e-10, atol=1e-12)
    back = natural(there)
    np.testing.assert_allclose(back.f, form.f, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(back.M, form.M)


@pytest.mark.parametrize("shape", [(), (5,)])
@pytest.mark.parametrize("method", ["cholesky", "pinv", "lu"])
def test_methods_agree_on_a_positive_definite_metric(method, shape):
    form = random_form(3, shape)
    expected = np.linalg.solve(np.asarray(form.M), np.asarray(form.f)[..., None])[..., 0]
    np.testing.assert_allclose(resolve(form, method), expected, rtol=1e-10, atol=1e-12)


def test_the_pseudo_inverse_gives_the_least_acceleration_where_the_metric_is_singular():
    J = jnp.asarray(np.random.default_rng(4).normal(size=(2, 5)))
    form = NaturalForm(J.T @ jnp.asarray([1.0, -2.0]), J.T @ J)
    a = np.asarray(resolve(form, "pinv"))
    np.testing.assert_allclose(form.M @ a, form.f, atol=1e-10)
    np.testing.assert_allclose(a, np.linalg.lstsq(np.asarray(form.M), np.asarray(form.f), rcond=1e-10)[0], atol=1e-10)
    null = np.linalg.svd(np.asarray(J))[2][2:]
    np.testing.assert_allclose(null @ a, 0, atol=1e-10)


def test_cholesky_does_not_hide_a_singular_metric():
    assert not np.isfinite(resolve(NaturalForm(jnp.ones(2), jnp.zeros((2, 2))))).any()


def test_an_unknown_method_is_named_with_the_nearest_valid_one():
    with pytest.raises(UnknownNameError, match="unknown method 'colesky'. Did you mean 'cholesky'.*pinv, lu"):
        resolve(random_form(0), "colesky")  # type: ignore[arg-type]


def test_diagonal_forms_add_to_each_other_and_to_dense_ones_and_nothing_else():
    a = DiagonalForm(jnp.asarray([1.0, 2.0]), jnp.asarray([3.0, 4.0]))
    dense = NaturalForm(jnp.ones(2), jnp.ones((2, 2)))
    assert isinstance(a + a, DiagonalForm)
    np.testing.assert_array_equal((a + a).dense().M, np.diag([6.0, 8.0]))
    for total in (a + dense, dense + a):
        np.testing.assert_array_equal(total.f, [2.0, 3.0])
        np.testing.assert_array_equal(total.M, [[4.0, 1.0], [1.0, 5.0]])
    with pytest.raises(ShapeError, match="common space"):
        a + DiagonalForm(jnp.ones(3), jnp.ones(3))
    with pytest.raises(TypeError):
        a + 1.0
