"""Occupancy grids drawn from scans at known poses, by counting (Hähnel et al. 2003).

A cell is occupied where the scans that end in it are not too few beside those that see through it.
"""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aprjax.grid.occupancy_grid import (
    COARSEST,
    FINEST,
    FREE,
    MOST_CELLS,
    OCCUPIED,
    UNKNOWN,
    OccupancyGrid,
)
from aprjax.numerics import arctan2, bucket, single_precision
from aprjax.scan import Scan, as_stack
from aprjax.se2 import Pose

# Share of the scans of a cell that end in it, from which on it is occupied: surfaces are thinner
# than a cell and poses centimetres off, so that many of the others miss it.
_SHARE = 0.35
_MOST_CELLS = MOST_CELLS >> 2  # within reach of a scan, for each of which it is asked what is there
_CLEAR = 1.5  # cells before a hit that nothing is said of: it may lie in any part of its own


@single_precision()
def grid_from_scans(
    scans: Sequence[Scan] | Scan,
    T_world_laser: np.ndarray,
    *,
    resolution: float = 0.05,
    reach: float = 15.0,
    join: float = 0.3,
) -> OccupancyGrid:
    """The grid, its axes those of the world, of scans taken at poses `(N, 3)`.

    `scans` is a list or a stacked `Scan` `(N, slots)`. `resolution` is a cell's width, `reach`
    how far along its beams a scan counts, and `join` the widest gap between the hits of
    neighbouring beams that is drawn as surface, all in metres. Free is what lies between two
    neighbouring beams up to the shorter one's end, and along each beam. Raises `ValueError`
    naming a field for shapes that do not fit each other, for poses and lengths that make no
    sense, for a reach of over 4000 cells, for scans without a hit within it, and where the poses
    lie so far apart that the grid would have over 2²⁸ cells, or twice as many within reach.
    """
    scans = as_stack(scans, "scans")
    poses = np.asarray(T_world_laser, float)
    if poses.shape != (len(scans.ranges), 3):
        raise ValueError(
            f"T_world_laser: shape {poses.shape} does not fit ranges {np.shape(scans.ranges)}"
        )
    for index in np.argwhere(~np.isfinite(poses))[:1]:
        raise ValueError(f"T_world_laser{index.tolist()}: {poses[tuple(index)]} is not finite")
    for name, value, low in (
        ("resolution", resolution, 0.0),
        ("reach", reach, resolution),
        ("join", join, 0.0),
    ):
        if not low < value < np.inf:
            raise ValueError(f"{name}: {value} m is not over {low} m and finite")
    if not FINEST <= resolution <= COARSEST:
        raise ValueError(f"resolution: {resolution} m is not from {FINEST} to {COARSEST}")
    across = 2 * _half(reach, resolution) + 1
    if across**2 > _MOST_CELLS:
        raise ValueError(
            f"resolution: at {resolution} m, a reach of {reach} m is {across} x {across} cells"
        )
    join = min(join, 2 * reach)  # which no two hits are farther apart than
    points = np.shape(scans.ranges)[1] * 2 * join / resolution
    if points > MOST_CELLS:
        raise ValueError(f"join: at {join} m, a scan may have {points:.0f} points of surface")
    surfaces = [
        _surface(scan, pose, resolution, reach, join)
        for scan, pose in zip(_each(scans), poses, strict=True)
    ]
    if not any(len(xy) for xy in surfaces):
        raise ValueError(f"scans: there is no hit within {reach} m")

    around = np.concatenate([*surfaces, poses[:, :2]])
    low = np.floor(around.min(axis=0) / resolution) - 1
    columns, rows = (np.ceil(around.max(axis=0) / resolution) - low + 1).tolist()
    fits = rows * columns <= MOST_CELLS
    shape = (int(rows), int(columns)) if fits else (0, 0)
    if not fits or math.prod(_with_margin(shape, _half(reach, resolution))) > 2 * MOST_CELLS:
        raise ValueError(f"T_world_laser: the poses span {rows:.0f} x {columns:.0f} cells")
    hits = np.zeros(shape, np.int32)
    for xy in surfaces:
        x, y = (np.floor(xy / resolution) - low).astype(int).T
        # A scan says at most once that a cell is occupied, as that it is free.
        hits[np.unravel_index(np.unique(np.ravel_multi_index((y, x), shape)), shape)] += 1
    local = np.column_stack([poses[:, :2] / resolution - low, poses[:, 2]]).astype(np.float32)
    passes = _passes(scans, local, shape, resolution, reach)
    seen = np.where(hits >= _SHARE * (hits + passes), OCCUPIED, FREE)
    cells = np.where(hits + passes > 0, seen, UNKNOWN)
    return OccupancyGrid.make(cells, resolution, [*low * resolution, 0.0])


def _each(scans: Scan):
    for i in range(len(scans.ranges)):
        yield jax.tree.map(lambda array: np.asarray(array)[i], scans)  # noqa: B023


def _surface(
    scan: Scan, T_world_laser: np.ndarray, resolution: float, reach: float, join: float
) -> np.ndarray:
    """Points `(n, 2)` in the world of the surface that a scan saw, under a cell apart."""
    ranges = np.asarray(scan.ranges, float)
    angle = float(scan.angle_min) + float(scan.angle_increment) * np.arange(len(ranges))
    angle = angle + T_world_laser[2]
    hit = (ranges >= scan.range_min) & (ranges <= min(float(scan.range_max), reach)) & (ranges > 0)
    hit &= np.arange(len(ranges)) < scan.beams
    length = np.where(hit, ranges, 0.0)[:, None]
    xy = T_world_laser[:2] + length * np.column_stack([np.cos(angle), np.sin(angle)])
    off = np.diff(xy, axis=0)
    joined = hit[1:] & hit[:-1] & (np.hypot(*off.T) <= join)
    share = np.arange(0, 1, min(resolution / join, 1.0) / 2)[1:]
    between = xy[:-1][joined][:, None] + share[:, None] * off[joined][:, None]
    return np.concatenate([xy[hit], between.reshape(-1, 2)])


def _half(reach: float, resolution: float) -> int:
    """Cells to each side of a laser that it can see."""
    return int(np.ceil(reach / resolution)) + 1


def _with_margin(shape: tuple[int, int], half: int) -> tuple[int, int]:
    """Rows and columns of a grid, up to the next bucket of sizes, with `half` cells all around."""
    rows, columns = (bucket(size, smallest=64) + 2 * half for size in shape)
    return rows, columns


def _passes(
    scans: Scan, pose: np.ndarray, shape: tuple[int, int], resolution: float, reach: float
) -> np.ndarray:
    """How many scans saw through each cell; `pose` `(N, 3)` in cells from the grid's corner."""
    # A window around the laser, so that the work goes by the reach and not by the grid; a margin
    # of half a window all around keeps it inside.
    half = _half(reach, resolution)
    free = _free_counts(
        jax.tree.map(np.asarray, scans), pose, np.float32(resolution), np.float32(reach),
        half, _with_margin(shape, half),
    )  # fmt: skip
    return np.asarray(free)[half : half + shape[0], half : half + shape[1]]


@jax.jit(static_argnames=("half", "shape"))
def _free_counts(
    scans: Scan,
    pose: Float[Array, "scans 3"],
    resolution: Float[Array, ""],
    reach: Float[Array, ""],
    half: int,
    shape: tuple[int, int],
) -> Int[Array, "rows columns"]:
    """Counts of the grid with a margin of `half` cells on each side."""

    def add(counts: Array, each: tuple[Scan, Array]) -> tuple[Array, None]:
        scan, pose = each
        corner = jnp.floor(pose[:2]).astype(jnp.int32)
        depth = _depth(scan, reach) / resolution
        free = _seen_through(scan, depth, pose.at[:2].add(-corner.astype(jnp.float32)), half)
        at = corner[1], corner[0]
        window = jax.lax.dynamic_slice(counts, at, free.shape)
        return jax.lax.dynamic_update_slice(counts, window + free, at), None

    counts, _ = jax.lax.scan(add, jnp.zeros(shape, jnp.int32), (scans, pose))
    return counts


def _depth(scan: Scan, reach: Float[Array, ""]) -> Float[Array, " beams"]:
    """How far each beam is known to be free, in metres; zero where nothing is known."""
    known = jnp.where(scan.hit, scan.ranges, jnp.where(scan.no_return, scan.range_max, 0.0))
    return jnp.minimum(known, reach)


def _seen_through(
    scan: Scan, depth: Float[Array, " beams"], pose: Pose, half: int
) -> Int[Array, "window window"]:
    """1 for each cell around the laser's own that is free; `pose` and `depth` are in cells."""
    side = jnp.arange(-half, half + 1, dtype=jnp.float32) + 0.5
    x, y = side[None, :] - pose[0], side[:, None] - pose[1]
    distance = jnp.sqrt(x * x + y * y)
    step = jnp.abs(scan.angle_increment)
    ahead = (arctan2(y, x) - pose[2] - scan.angle_min) * jnp.sign(scan.angle_increment)
    # From half a beam before the first one: that much to its other side is in view.
    position = jnp.mod(ahead + step / 2, 2 * jnp.pi) / step - 0.5
    slots, beams = depth.shape[0], scan.beams
    depth = jnp.where(jnp.arange(slots) < beams, depth, 0.0)

    def at(beam: Int[Array, "..."]) -> Float[Array, "..."]:
        turned = jnp.where(scan.full_turn, jnp.mod(beam, jnp.maximum(beams, 1)), beam)
        return depth.at[turned].get(mode="fill", fill_value=0.0, wrap_negative_indices=False)

    before = jnp.floor(position).astype(jnp.int32)
    nearest = jnp.round(position).astype(jnp.int32)
    between = jnp.minimum(at(before), at(before + 1))
    sideways = distance * jnp.abs(jnp.sin((position - nearest.astype(jnp.float32)) * step))
    along = jnp.where(sideways <= 0.5, at(nearest), 0.0)
    free = distance < jnp.maximum(between, along) - _CLEAR
    return free.astype(jnp.int32)
