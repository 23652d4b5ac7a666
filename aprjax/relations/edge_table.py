"""The edges of all references in one table, sorted by length: the index table of 2.B on the device.

Edges as long as a given one are neighbours in it, so that a query's corresponding edges in all
references are a few contiguous slices. `aprjax.relations.index_table` is its definition.
"""

from typing import Any, NamedTuple, Self

import equinox as eqx
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
    """Undirected edges, shortest first. Slots without one come last and are infinitely long."""

    length: Float[Array, "*edges"]
    """d in metres."""
    geometry: Float[Array, "*fields_and_edges"]
    """Coordinate by coordinate, as `Geometry` names them: a single array because what reads many
    is not vectorised by XLA on a CPU."""
    row: Int[Array, "*edges"]
    """The reference that the edge belongs to."""

    @classmethod
    def build(cls, graphs: AnchorGraph) -> Self:
        """The table of stacked graphs `(rows, ...)`; both are on the host.

        It has a slot for every edge that the capacities allow: its shape depends on theirs
        alone.
        """
        anchors = graphs.xy.shape[-2]
        a, b = np.triu_indices(anchors, k=1)
        valid = np.asarray(graphs.valid)[:, a, b]
        row, edge = np.nonzero(valid)
        order = np.argsort(np.asarray(graphs.length)[row, a[edge], b[edge]], kind="stable")
        row, edge = row[order], edge[order]
        start, stop = a[edge], b[edge]
        xy, unit = np.asarray(graphs.xy), np.asarray(graphs.unit)[row, start, stop]
        cos, sin = np.where(unit[:, 1:] < 0, -unit, unit).T
        x, y = 0.5 * (xy[row, start] + xy[row, stop]).T

        def padded(values: np.ndarray, fill: float = 0) -> Any:
            missing = [(0, 0)] * (values.ndim - 1) + [(0, valid.size - len(row))]
            return np.pad(values, missing, constant_values=fill)

        return cls(
            length=padded(np.asarray(graphs.length)[row, start, stop], fill=np.inf),
            geometry=padded(np.stack(Geometry(x, y, cos, sin, np.arctan2(sin, cos)))),
            row=padded(row.astype(np.int32)),
        )

    @classmethod
    def of(cls, graphs: AnchorGraph) -> Self:
        """The table of stacked graphs, traceable: as `build`, and slower for many."""
        rows, anchors = graphs.xy.shape[0], graphs.xy.shape[-2]
        a, b = np.triu_indices(anchors, k=1)
        length = jnp.where(graphs.valid[:, a, b], graphs.length[:, a, b], jnp.inf).reshape(-1)
        unit = graphs.unit[:, a, b].reshape(-1, 2)
        cos, sin = jnp.where(unit[:, 1:] < 0, -unit, unit).T
        x, y = (0.5 * (graphs.xy[:, a] + graphs.xy[:, b])).reshape(-1, 2).T
        real = jnp.isfinite(length)
        fields = Geometry(x, y, cos, sin, jnp.arctan2(sin, jnp.where(real, cos, 1.0)))
        order = jnp.argsort(length, stable=True)
        row = jnp.repeat(jnp.arange(rows, dtype=jnp.int32), len(a))
        geometry = jnp.where(real, jnp.stack(fields), 0.0)
        return cls(length[order], geometry[:, order], jnp.where(real, row, 0)[order])

    def window(
        self, length: Float[Array, "*k"], tolerance: Float[Array, ""]
    ) -> tuple[Int[Array, "*k"], Int[Array, "*k"]]:
        """Begin and end of the slots whose edges are as long as `length` to within `tolerance`."""
        begin = jnp.searchsorted(self.length, length - tolerance, side="left")
        end = jnp.searchsorted(self.length, length + tolerance, side="right")
        return begin.astype(jnp.int32), end.astype(jnp.int32)
