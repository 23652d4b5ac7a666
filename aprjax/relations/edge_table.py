"""The edges of all references, sorted by length: the index table of 2.B on the device.

Edges as long as a given one are neighbours in it, so that a query's corresponding edges are a few
contiguous slices. References come in blocks, each with a table of its own, so that what a query
counts for one block is bounded. `aprjax.relations.index_table` is the definition of each table.
"""

from typing import Any, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aprjax.relations.graph import AnchorGraph


class Geometry(NamedTuple):
    """Where edges lie, in the frame of their reference."""

    x: Float[Array, "*edges"]
    """Of the middle of each edge, in metres."""
    y: Float[Array, "*edges"]
    cos: Float[Array, "*edges"]
    """Of its direction, in [0, π]: an edge has no sense."""
    sin: Float[Array, "*edges"]
    direction: Float[Array, "*edges"]
    """Radians."""


class EdgeTable(eqx.Module):
    """Undirected edges, those of each block of references together, shortest first.

    Slots without one come last in their block and are infinitely long.
    """

    length: Float[Array, "blocks slots"]
    """d in metres."""
    geometry: Float[Array, "fields blocks slots"]
    """Coordinate by coordinate, as `Geometry` names them: a single array because what reads many
    is not vectorised by XLA on a CPU."""
    row: Int[Array, "blocks slots"]
    """The reference that the edge belongs to, counted from the first of the block."""

    @classmethod
    def build(cls, graphs: AnchorGraph) -> Self:
        """The table of stacked graphs `(rows, ...)`; both are on the host.

        It has a slot for every edge that the capacities allow: its shape depends on theirs
        alone.
        """
        a, b = np.triu_indices(graphs.xy.shape[-2], k=1)
        valid = np.asarray(graphs.valid)[:, a, b]
        blocks, height = blocks_of(*valid.shape)
        row, edge = np.nonzero(valid)
        length = np.asarray(graphs.length)[row, a[edge], b[edge]]
        order = np.lexsort((length, row // height))
        row, edge = row[order], edge[order]
        start, stop = a[edge], b[edge]
        xy, unit = np.asarray(graphs.xy), np.asarray(graphs.unit)[row, start, stop]
        cos, sin = np.where(unit[:, 1:] < 0, -unit, unit).T
        x, y = 0.5 * (xy[row, start] + xy[row, stop]).T
        block = row // height
        slot = np.arange(len(row)) - np.searchsorted(block, block)

        def placed(values: np.ndarray, fill: float = 0) -> Any:
            shape = (*values.shape[:-1], blocks, height * len(a))
            array = np.full(shape, fill, values.dtype)
            array[..., block, slot] = values
            return array

        return cls(
            length=placed(length[order], fill=np.inf),
            geometry=placed(np.stack(Geometry(x, y, cos, sin, np.arctan2(sin, cos)))),
            row=placed((row % height).astype(np.int32)),
        )

    @classmethod
    def of(cls, graphs: AnchorGraph) -> Self:
        """The table of stacked graphs, traceable: as `build`, and slower for many."""
        a, b = np.triu_indices(graphs.xy.shape[-2], k=1)
        blocks, height = blocks_of(graphs.xy.shape[0], len(a))

        def blockwise(array: Array, fill: float = 0) -> Array:
            """Of each row's edges; `(blocks, slots, ...)`."""
            missing = [(0, blocks * height - array.shape[0])] + [(0, 0)] * (array.ndim - 1)
            padded = jnp.pad(array, missing, constant_values=fill)
            return padded.reshape(blocks, height * len(a), *array.shape[2:])

        length = blockwise(
            jnp.where(graphs.valid[:, a, b], graphs.length[:, a, b], jnp.inf), np.inf
        )
        unit = blockwise(graphs.unit[:, a, b])
        cos, sin = jnp.moveaxis(jnp.where(unit[..., 1:] < 0, -unit, unit), -1, 0)
        x, y = jnp.moveaxis(blockwise(0.5 * (graphs.xy[:, a] + graphs.xy[:, b])), -1, 0)
        real = jnp.isfinite(length)
        fields = Geometry(x, y, cos, sin, jnp.arctan2(sin, jnp.where(real, cos, 1.0)))
        geometry = jnp.where(real, jnp.stack(fields), 0.0)
        row = jnp.where(real, jnp.repeat(jnp.arange(height, dtype=jnp.int32), len(a)), 0)
        order = jnp.argsort(length, axis=-1, stable=True)
        return cls(
            length=jnp.take_along_axis(length, order, axis=-1),
            geometry=jnp.take_along_axis(geometry, order[None], axis=-1),
            row=jnp.take_along_axis(row, order, axis=-1),
        )

    def windows(
        self, length: Float[Array, " k"], tolerance: Float[Array, ""]
    ) -> tuple[Int[Array, "blocks k"], Int[Array, "blocks k"]]:
        """Begin and end of each block's slots with edges as long as `length` within `tolerance`."""
        bounds = length - tolerance, length + tolerance
        shorter = jax.vmap(_shorter, (0, None, None))
        return shorter(self.length, bounds[0], False), shorter(self.length, bounds[1], True)


def _shorter(
    length: Float[Array, " slots"], bound: Float[Array, " k"], or_equal: bool
) -> Int[Array, " k"]:
    """How many of ascending lengths are below each bound, or equal to it.

    By counting, among every so many of them and then among those between: half a dozen operations,
    where a bisection has that many in each of its steps.
    """

    def count(some: Float[Array, "... any"]) -> Int[Array, " k"]:
        below = some <= bound[:, None] if or_equal else some < bound[:, None]
        return jnp.sum(below, axis=-1, dtype=jnp.int32)

    first = jnp.maximum(count(length[None, ::_STRIDE]) - 1, 0) * _STRIDE
    near = first[:, None] + jnp.arange(_STRIDE, dtype=jnp.int32)[None]
    return first + count(length.at[near].get(mode="fill", fill_value=jnp.inf))


_STRIDE = 128
"""About the square root of the slots of a block, so that both counts are as long."""


def blocks_of(rows: int, edges: int) -> tuple[int, int]:
    """How many blocks there are, and references in each, for `rows` with up to `edges` edges each.

    What a block's votes take is bounded by `_ROWS`; and 32 bits are to number both senses of each
    pair of an edge of a query and one of the block.
    """
    most = min(_ROWS, np.iinfo(np.int32).max // (2 * edges**2))
    blocks = -(-rows // most)
    return blocks, -(-rows // blocks)


_ROWS = 256
"""References in a block, at most: by default, a query's votes for them take 3 MB."""
