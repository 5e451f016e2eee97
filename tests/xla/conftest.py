import jax
import pytest


@pytest.fixture
def x64():
    with jax.enable_x64(True):
        yield


@pytest.fixture(autouse=True)
def _machinery_is_on():
    """These tests are of the machinery: they hold wherever JAXRMP_XLA stands."""
    from jaxrmp.xla import machinery

    with machinery(True):
        yield
