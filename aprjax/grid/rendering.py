"""What a scanner would see in an occupancy grid: ray casting from cell to cell."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.grid.surface import Surfaces, meet, surfaces
from aprjax.numerics import bucket, single_precision
from aprjax.plane import compose, inverse
from aprjax.scan import Scan, hide_nan, show_nan
from aprjax.se2 import Pose

_FREE, _OCCUPIED, _UNKNOWN = 0, 1, 2
_CHUNK = 32  # scans rendered at a time
_STILL = 1e-9  # the least part of a step along an axis: a ray parallel to the other


class Cells(eqx.Module):
    """What a ray meets in each cell of a grid, in units of cells."""

    state: Int[Array, "rows columns"]
    surface: Surfaces

    @classmethod
    def of(cls, grid: OccupancyGrid) -> "Cells":
        """On the host, with unknown cells all around, up to the next bucket of sizes."""
        state = np.where(grid.occupied, _OCCUPIED, np.where(grid.free, _FREE, _UNKNOWN))
        rows, columns = (bucket(size + 1, smallest=64) for size in state.shape)
        width = [(0, rows - state.shape[0]), (0, columns - state.shape[1])]

        def pad(array: np.ndarray, fill: int = 0) -> np.ndarray:
            return np.pad(array, width + [(0, 0)] * (array.ndim - 2), constant_values=fill)

        return cls(
            pad(state.astype(np.int8), _UNKNOWN),  # pyright: ignore[reportArgumentType]
            jax.tree.map(pad, surfaces(grid.occupied)),
        )

    def at(self, x: Int[Array, "..."], y: Int[Array, "..."]) -> Int[Array, "..."]:
        """The states of cells; outside of the grid all are unknown."""
        return self.state.at[y, x].get(
            mode="fill", fill_value=_UNKNOWN, wrap_negative_indices=False
        )


def cast(
    cells: Cells,
    T_grid_laser: Pose,
    bearings: Float[Array, " rays"],
    range_max: Float[Array, ""],
) -> Float[Array, " rays"]:
    """Distances along each ray, all in cells and radians, for one pose.

    A hit is where the ray meets the line of the first occupied cell; where that has none, the
    middle of the ray's way through it. +inf where all is free up to `range_max`, NaN where an
    unknown cell comes before, or the laser is in no free cell.
    """
    angle = T_grid_laser[2] + bearings
    along = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    start = T_grid_laser[:2, None]
    speed = jnp.maximum(jnp.abs(along), _STILL)
    step = jnp.where(along < 0, -1, 1)
    first = jnp.floor(start)
    # Way to the first border in either direction; later ones follow at even distances.
    before = jnp.where(along < 0, start - first, first + 1 - start) / speed
    origin = jnp.broadcast_to(first.astype(jnp.int32), along.shape)

    def leave(crossed: Int[Array, "2 rays"]) -> Float[Array, "2 rays"]:
        """Where a ray meets the next border of either direction."""
        return before + crossed.astype(jnp.float32) / speed

    def look(crossed: Int[Array, "2 rays"]) -> Int[Array, " rays"]:
        x, y = origin + step * crossed
        return cells.at(x, y)

    def running(state):
        _, entry, met = state
        return jnp.any((met == _FREE) & (entry <= range_max))

    def advance(state):
        crossed, entry, met = state
        border = leave(crossed)
        sideways = border[0] < border[1]
        more = jnp.stack([sideways, ~sideways]).astype(jnp.int32)
        ahead = (met == _FREE) & (entry <= range_max)
        entry = jnp.where(ahead, jnp.min(border, axis=0), entry)
        crossed = crossed + jnp.where(ahead[None], more, 0)
        return crossed, entry, jnp.where(ahead, look(crossed), met)

    crossed = jnp.zeros(along.shape, jnp.int32)
    entry = jnp.zeros_like(bearings)
    crossed, entry, met = jax.lax.while_loop(running, advance, (crossed, entry, look(crossed)))
    middle = (entry + jnp.min(leave(crossed), axis=0)) / 2
    hit = (met == _OCCUPIED) & (entry > 0)
    x, y = origin + step * crossed
    line = jax.tree.map(lambda array: array[y, x], cells.surface)
    middle = jnp.maximum(meet(line, start, along, middle), 0.0)
    free = (entry > range_max) | (hit & (middle > range_max))
    return jnp.where(free, jnp.inf, jnp.where(hit, middle, jnp.nan))


@single_precision()
def render(grid: OccupancyGrid, T_world_laser: np.ndarray, like: Scan) -> Scan:
    """Scans of a grid from poses `(N, 3)` in metres and radians, stacked on the host.

    Their beams and limits are those of `like`, one scan. Nothing is random: a beam says the
    distance to the surface in the first occupied cell on its way, see `surfaces`, +inf where all
    is free up to the limit, NaN where unknown cells come before. Compiles once for each bucket of
    sizes of the grid. Raises `ValueError` for poses of another shape or that are not finite, and
    for a `like` that is a batch.
    """
    poses = np.asarray(T_world_laser, float)
    if poses.ndim != 2 or poses.shape[1] != 3 or not len(poses):
        raise ValueError(f"T_world_laser: shape {poses.shape} is not (N, 3) with N from 1")
    for index in np.argwhere(~np.isfinite(poses))[:1]:
        raise ValueError(f"T_world_laser{index.tolist()}: {poses[tuple(index)]} is not finite")
    if np.ndim(like.ranges) != 1:
        raise ValueError(f"like: ranges have shape {np.shape(like.ranges)}, not (beams,)")
    # In the grid's frame and in cells, a float32 is fine enough however far off the origin is.
    T_grid_laser = compose(inverse(grid.T_world_grid), poses)
    T_grid_laser[:, :2] /= grid.resolution
    count = len(poses)
    padded = np.pad(T_grid_laser, [(0, -count % _CHUNK), (0, 0)]).astype(np.float32)
    cells = jax.device_put(Cells.of(grid))
    parts = [
        _render_chunk(cells, padded[i : i + _CHUNK], np.float32(grid.resolution), like)
        for i in range(0, count, _CHUNK)
    ]
    return show_nan(*jax.tree.map(lambda *each: np.concatenate(each)[:count], *parts))


@jax.jit
def _render_chunk(
    cells: Cells, T_grid_laser: Float[Array, "chunk 3"], resolution: Float[Array, ""], like: Scan
) -> tuple[Scan, Bool[Array, "chunk slots"]]:
    def one(pose: Pose) -> Scan:
        range_max = jnp.asarray(like.range_max)
        ranges = cast(cells, pose, jnp.asarray(like.bearings), range_max / resolution) * resolution
        return eqx.tree_at(
            lambda scan: scan.ranges,
            jax.tree.map(jnp.asarray, like),
            jnp.where(jnp.asarray(like.real), ranges, jnp.nan),
        )

    return hide_nan(jax.vmap(one)(T_grid_laser))
