"""Environments for learners that speak gymnasium, which is asked for here alone."""

from typing import Any

from .._errors import ConfigurationError, importing
from ._residual import ResidualEnvironment


def gymnasium_env(environment: ResidualEnvironment) -> Any:
    """The `environment` as a `gymnasium.Env`; `info` is what `Told` has, by name.

    **Raises** `MissingDependencyError` without gymnasium, the extra `gym`.
    """
    with importing("gymnasium", "gym"):
        from ._gymnasium import ResidualEnv
    return ResidualEnv(environment)


def gymnasium_vector_env(environment: ResidualEnvironment, count: int) -> Any:
    """`count` copies of the `environment` as one `gymnasium.vector.VectorEnv`, whose step is one compiled call.

    After the last step of an episode the next one of that environment begins anew, `AutoresetMode.NEXT_STEP`.
    **Raises** `ConfigurationError` for a count below one, and as `gymnasium_env`.
    """
    if count < 1:
        raise ConfigurationError(f"count is {count!r}, expected at least one.")
    with importing("gymnasium", "gym"):
        from ._gymnasium import ResidualVectorEnv
    return ResidualVectorEnv(environment, count)
