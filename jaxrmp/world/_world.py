"""The world around the robot: obstacles of all kinds."""

from typing import Any

import jax
import jax.numpy as jnp

from .._errors import ConfigurationError, ShapeError
from .._pytree import pytree, set_field
from ._boxes import Boxes
from ._capsules import Capsules
from ._components import columns
from ._cylinders import Cylinders
from ._grid import SignedDistanceGrid
from ._half_spaces import HalfSpaces
from ._obstacles import FAR, Obstacles
from ._spheres import Spheres

_PADDED: dict[str, Any] = dict(
    spheres=Spheres, capsules=Capsules, boxes=Boxes, cylinders=Cylinders, half_spaces=HalfSpaces
)


@pytree
class World:
    """Obstacles of all kinds, in this order: spheres, capsules, boxes, cylinders, half-spaces, grids.

    A row that is not finite in any field, as depth cameras mark pixels without depth, is inactive, whatever `active`
    says, in a compiled function too, and `ignored` counts it; outside of one, making it warns.

    A world is a parameter: moving, changing, activating and disabling obstacles recompiles nothing as long as each
    kind keeps its number of slots.

    **Arguments**: `spheres`, `capsules`, `boxes`, `cylinders`, `half_spaces`, each none by default, and None too where
    it is given without slots; `grids`, a tuple of `SignedDistanceGrid`.
    **Raises** `ConfigurationError` if an argument is of another kind.

    >>> scene = World(spheres=Spheres.of([((0, 0, 2), 0.5)], capacity=2))
    >>> scene.signed_distance(jnp.zeros(3)).tolist()
    [1.5, 1000.0]
    """

    spheres: Spheres | None = None
    capsules: Capsules | None = None
    boxes: Boxes | None = None
    cylinders: Cylinders | None = None
    half_spaces: HalfSpaces | None = None
    grids: tuple[SignedDistanceGrid, ...] = ()

    def __post_init__(self):
        for name, kind in _PADDED.items():
            given = getattr(self, name)
            if given is not None and not isinstance(given, kind):
                raise ConfigurationError(f"{name} is a {type(given).__name__}, expected {kind.__name__}.")
            if given is not None and not given.size:  # no slots, and so nothing to pass to a compiled function
                set_field(self, name, None)
        grids: Any = (self.grids,) if isinstance(self.grids, SignedDistanceGrid) else tuple(self.grids)
        for grid in grids:
            if not isinstance(grid, SignedDistanceGrid):
                raise ConfigurationError(f"grids holds a {type(grid).__name__}, expected SignedDistanceGrid.")
        set_field(self, "grids", grids)

    @property
    def kinds(self) -> tuple[Obstacles, ...]:
        """The kinds that have slots, in order; what is ignored is inactive."""
        return tuple(kind.usable()[0] for kind in self._given)

    @property
    def _given(self) -> tuple[Obstacles, ...]:
        kinds: tuple[Any, ...] = (*(getattr(self, name) for name in _PADDED), *self.grids)
        return tuple(kind for kind in kinds if kind is not None and kind.size)

    @property
    def size(self) -> int:
        """Number O of obstacle slots."""
        return sum(kind.size for kind in self._given)

    @property
    def ignored(self) -> jax.Array:
        """How many active obstacles, and values of grids, are ignored, since they are not finite, a size is negative,
        or something is beyond 1e9 m. Compiled too: return it beside what a policy gives, where a camera makes worlds.
        """
        return jnp.asarray(sum(kind.usable()[1] for kind in self._given), int)

    @property
    def active(self) -> jax.Array:
        """Which slots hold an obstacle, [O]; not one that is ignored."""
        return jnp.concatenate([jnp.zeros(0, bool), *(jnp.reshape(kind.active, (kind.size,)) for kind in self.kinds)])

    def signed_distance(self, p: jax.Array) -> jax.Array:
        """Signed distance of a point to each obstacle: exact, negative inside; 1e3 to an inactive slot.

        **Arguments**: `p` [..., 3], m. **Returns** [..., O], m. **Raises** `ShapeError`.
        """
        p = jnp.asarray(p)
        if p.shape[-1:] != (3,):
            raise ShapeError(f"p has shape {p.shape}, expected [..., 3].")
        return self.mask_inactive(self.over_kinds(p, lambda kind: kind.distance(columns(p))), FAR)

    def over_kinds(self, like: jax.Array, evaluate: Any) -> jax.Array:
        """`evaluate`, `kind -> [..., n]`, of every kind, side by side [..., O]; `like` [..., 3] gives the shape."""
        none = jnp.zeros((*like.shape[:-1], 0), like.dtype)
        return jnp.concatenate([none, *(evaluate(kind) for kind in self.kinds)], axis=-1)

    def mask_inactive(self, values: jax.Array, fill: float) -> jax.Array:
        """`values` [..., O] with `fill` in place of those of inactive slots."""
        return jnp.where(self.active, values, fill)


def ignored_in(tree: Any) -> jax.Array:
    """`World.ignored` of all the worlds in `tree`, a policy's or any pytree: a point cloud given to `LulaPolicy.tree`
    is one.

    >>> int(ignored_in(World(spheres=Spheres.of([((0, 0, 2), 0.5)], capacity=2))))
    0
    """
    found = jax.tree.leaves(tree, is_leaf=lambda x: isinstance(x, World))
    return jnp.asarray(sum(x.ignored for x in found if isinstance(x, World)), int)
