"""Environments for reinforcement learning, whose controller is a policy: pure functions over arrays, and gymnasium's.

`reset` and `step` are functions of an environment, a state and an action, to be compiled by `jax.jit` and mapped by
`jax.vmap` over states, actions or environments; `gymnasium_env` and `gymnasium_vector_env` make of one what other
libraries take.
"""

from ._as_gymnasium import gymnasium_env as gymnasium_env
from ._as_gymnasium import gymnasium_vector_env as gymnasium_vector_env
from ._residual import RESIDUAL as RESIDUAL
from ._residual import EnvironmentState as EnvironmentState
from ._residual import ResidualEnvironment as ResidualEnvironment
from ._residual import Told as Told
from ._residual import Transition as Transition
from ._residual import reset as reset
from ._residual import residual_certificate as residual_certificate
from ._residual import sooner as sooner
from ._residual import step as step
from ._residual import step_or_reset as step_or_reset
