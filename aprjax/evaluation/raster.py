"""A glance at very many alignments: end points of one scan on a coarse drawing of the other.

Every pose that edges vote for passes here, so that only those which earned it are looked at more
closely. One memory access takes the place of a look-up by bearing.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.view import View
from aprjax.numerics import in_parts
from aprjax.se2 import Pose

_AGREES, _CONTRADICTS = 1, 127
"""Of cells. A sum of fewer than 127 holds the number of either."""
_FAR = 1e6
_TINY = np.finfo(np.float32).tiny


class RasterConfig(eqx.Module):
    """What is drawn, and which end points are looked up."""

    cell: Float[Array, ""] = threshold(0.25, "metres: side of a cell", least=0.001)
    tolerance: Float[Array, ""] = threshold(0.2, "metres off the surface that is drawn as such")
    relative: Float[Array, ""] = threshold(0.02, "the same, per metre of range")
    size: int = capacity(96, "cells of each side; the scanner is in the middle")
    points: int = capacity(32, "most end points of a scan, less than 127")

    def __check_init__(self) -> None:
        if self.points >= _CONTRADICTS:
            raise ValueError(f"points: {self.points} is not between 1 and {_CONTRADICTS - 1}")


class Raster(eqx.Module):
    """One view, drawn, and a few of its end points."""

    cells: Int[Array, "*batch size size"]
    """What an end point in the cell says: it agrees, it contradicts (free space), or neither."""
    x: Float[Array, "*batch points"]
    """End points in metres; far away where there is none."""
    y: Float[Array, "*batch points"]
    hits: Float[Array, "*batch"]
    """Number of end points."""


class GlanceConfig(eqx.Module):
    """What a glance is worth."""

    doubt: Float[Array, ""] = threshold(0.1, "doubtful points assumed beforehand, a share of hits")
    contradiction: Float[Array, ""] = threshold(
        1.5, "agreeing points that one contradiction undoes"
    )
    votes: Float[Array, ""] = threshold(1.0, "rating of a vote that is worth one half")


def raster(view: View, config: RasterConfig) -> Raster:
    """The drawing of one view: what an end point at the middle of each cell would say."""
    centre = np.arange(config.size) + 0.5 - config.size / 2
    i, j = (axis.ravel() for axis in np.meshgrid(centre, centre, indexing="ij"))
    bearing = np.arctan2(j, i).astype(np.float32)
    distance = config.cell * np.hypot(i, j).astype(np.float32)
    index, visible = view.scanner.towards(jnp.asarray(bearing))
    met = jnp.where(view.hit, view.range, 0.0)[index]
    tolerance = config.tolerance + config.relative * distance
    known = visible & (met > 0)
    agrees = known & (jnp.abs(distance - met) <= tolerance)
    contradicts = known & (distance - met < -tolerance)
    cells = _AGREES * agrees.astype(jnp.int8) + _CONTRADICTS * contradicts.astype(jnp.int8)

    beam, real = view.thin(config.points)
    hit = real & view.hit[beam]
    return Raster(
        cells=cells.reshape(config.size, config.size),
        x=jnp.where(hit, view.xy[beam, 0], _FAR),
        y=jnp.where(hit, view.xy[beam, 1], _FAR),
        hits=jnp.sum(hit, dtype=jnp.float32),
    )


def glance(
    references: Raster,
    row: Int[Array, " poses"],
    query: Raster,
    T_ref_query: Float[Array, "poses 3"],
    rating: Float[Array, " poses"],
    raster_config: RasterConfig,
    config: GlanceConfig,
) -> Float[Array, " poses"]:
    """How far two drawings agree, both ways, in [0, 1], and how many edges voted for it.

    `row` says which of the stacked `references` each pose is meant for.
    """
    met = jax.vmap(_cells_met, (None, 0, None, 0, None))(
        references, row, query, T_ref_query, raster_config
    )

    def told(cells: Int[Array, "*all size size"], at: Int[Array, "part points"]) -> Array:
        found = cells.reshape(-1).at[jnp.maximum(at, 0)].get(mode="promise_in_bounds")
        return jnp.sum(jnp.where(at >= 0, found.astype(jnp.int32), 0), axis=1)

    def look_up(met: tuple[Array, Array]) -> tuple[Array, Array]:
        return told(references.cells, met[0]), told(query.cells, met[1])

    def share(said: Int[Array, " poses"], hits: Float[Array, "*poses"]) -> Float[Array, " poses"]:
        """Of agreeing points."""
        agree = (said % _CONTRADICTS).astype(jnp.float32)
        against = (said // _CONTRADICTS).astype(jnp.float32) * config.contradiction
        return agree / jnp.maximum(agree + against + config.doubt * hits, 1.0)

    ahead, back = in_parts(look_up, met)
    voted = rating / jnp.maximum(rating + config.votes, _TINY)
    return share(ahead, query.hits) * share(back, references.hits[row]) * voted


def _cells_met(
    references: Raster, row: Int[Array, ""], query: Raster, T_ref_query: Pose, config: RasterConfig
) -> tuple[Int[Array, " points"], Int[Array, " points"]]:
    """In one pose, the cells in which end points of either scan lie on the other's drawing, or -1.

    The reference's are numbered through all `references`.
    """
    size = config.size

    def cell(x: Float[Array, " points"], y: Float[Array, " points"]) -> Int[Array, " points"]:
        i = jnp.floor(x / config.cell + size / 2).astype(jnp.int32)
        j = jnp.floor(y / config.cell + size / 2).astype(jnp.int32)
        inside = (i >= 0) & (i < size) & (j >= 0) & (j < size)
        return jnp.where(inside, i * size + j, -1)

    x, y = T_ref_query[0], T_ref_query[1]
    cos, sin = jnp.cos(T_ref_query[2]), jnp.sin(T_ref_query[2])
    ahead = cell(cos * query.x - sin * query.y + x, sin * query.x + cos * query.y + y)
    dx, dy = references.x[row] - x, references.y[row] - y
    back = cell(cos * dx + sin * dy, cos * dy - sin * dx)
    return jnp.where(ahead >= 0, row * (size * size) + ahead, -1), back
