"""Where in its cells a surface runs: a straight line fitted to the occupied cells around each."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Bool, Float

_RADIUS = 3  # cells to each side that a line is fitted to
_LEAST = 4  # cells that make a line
_THICK = 0.8  # square cells: variance across a surface up to which it is one; three cells have 0.7
_LONG = 1.0  # square cells: least variance along it
_SLENDER = 4.0  # least ratio of the two
_FAR = 2.0  # cells that a line may move a hit across itself
_GRAZING = 0.15  # sine of the angle between a ray and a line under which they do not meet


class Surfaces(eqx.Module):
    """A line for each cell of a grid, in units of cells: points p with `normal` · p = `offset`."""

    normal: Float[Array, "*cells 2"]
    offset: Float[Array, "*cells"]
    valid: Bool[Array, "*cells"]
    """False where the cells around, such as those of a corner, lie on no line."""


def surfaces(occupied: np.ndarray) -> Surfaces:
    """Lines through the occupied cells `(rows, columns)` by their moments around each, on the host.

    A wall in a grid is a staircase, and several cells thick where poses were off.
    """
    mask = occupied.astype(np.float32)
    step = np.arange(-_RADIUS, _RADIUS + 1, dtype=np.float32)

    def moment(x: int, y: int) -> np.ndarray:
        rows = scipy.ndimage.correlate1d(mask, step**x, axis=1, mode="constant")
        return np.asarray(scipy.ndimage.correlate1d(rows, step**y, axis=0, mode="constant"))

    count = np.maximum(moment(0, 0), 1)
    x, y = moment(1, 0) / count, moment(0, 1) / count
    xx, yy = moment(2, 0) / count - x * x, moment(0, 2) / count - y * y
    xy = moment(1, 1) / count - x * y
    spread = np.hypot(xx - yy, 2 * xy)
    across, along = (xx + yy - spread) / 2, (xx + yy + spread) / 2
    angle = np.arctan2(2 * xy, xx - yy) / 2
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    row, column = np.indices(mask.shape, np.float32)
    offset = normal[..., 0] * (column + 0.5 + x) + normal[..., 1] * (row + 0.5 + y)
    valid = (count >= _LEAST) & (across <= _THICK)
    valid &= (along >= _LONG) & (along >= _SLENDER * across)
    return Surfaces(normal, offset, valid)  # pyright: ignore[reportArgumentType]


def meet(
    surface: Surfaces,
    start: Float[Array, "2 rays"],
    ray: Float[Array, "2 rays"],
    depth: Float[Array, " rays"],
) -> Float[Array, " rays"]:
    """`depth` of hits along rays, moved to the lines of the cells that were hit; all in cells.

    Where a line is not valid, or almost along the ray, the hit stays.
    """
    toward = jnp.sum(surface.normal.T * ray, axis=0)
    gap = surface.offset - jnp.sum(surface.normal.T * start, axis=0) - depth * toward
    met = surface.valid & (jnp.abs(toward) >= _GRAZING)
    moved = depth + jnp.clip(gap, -_FAR, _FAR) / jnp.where(met, toward, 1.0)
    return jnp.where(met, moved, depth)
