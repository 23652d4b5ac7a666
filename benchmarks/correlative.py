"""A correlative scan matcher in plain NumPy: what one would write without aprjax.

After E. Olson, Real-Time Correlative Scan Matching (ICRA 2009): the reference scan becomes a
raster of how likely an end point is at each place; of all rotations and translations, the one
whose end points are likeliest wins. A pyramid of rasters, each the maximum over what a coarser
cell may lead to, bounds the score from above, so that the search goes from coarse to fine and
finds what an exhaustive one would. It tells nothing of how sure the answer is.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

CELL = 0.05  # metres, of the finest raster
FACTOR = 4  # by which cells grow from level to level
LEVELS = 3
DEVIATION = 0.1  # metres that an end point may be off, standard deviation
TURN = np.radians(1.0)  # step of the rotations
REACH = 10.0  # metres of translation that are searched, to each side
_BATCH = 64  # candidates that are followed to the finest level together


@dataclass(frozen=True)
class Raster:
    """Likelihood around one reference scan, on all levels."""

    origin: np.ndarray
    """`(2,)` metres: corner of the first cell, the same on all levels."""
    levels: tuple[np.ndarray, ...]
    """Finest first. A cell of level k holds the most that end points reach which lie in it, or
    come into it or the next cell when shifted by less than one cell."""

    @classmethod
    def of(cls, points: np.ndarray) -> Self:
        """The raster of a reference's end points `(points, 2)` in metres."""
        coarsest = CELL * FACTOR ** (LEVELS - 1)
        margin = 4 * DEVIATION + 2 * coarsest
        origin = points.min(axis=0) - margin
        cells = np.ceil((np.ptp(points, axis=0) + 2 * margin) / coarsest).astype(int)
        fine = np.zeros(cells * FACTOR ** (LEVELS - 1), np.float32)
        window = int(3 * DEVIATION / CELL)
        side = np.arange(-window, window + 1)
        around = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        cell = ((points - origin) / CELL).astype(int)[:, None] + around
        off = np.sum((origin + (cell + 0.5) * CELL - points[:, None]) ** 2, axis=-1)
        np.maximum.at(fine, tuple(np.moveaxis(cell, -1, 0)), np.exp(-0.5 * off / DEVIATION**2))
        levels, width = [fine], 1
        for _ in range(1, LEVELS):
            width *= FACTOR
            rows, columns = np.array(fine.shape) // width
            coarse = fine.reshape(rows, width, columns, width).max(axis=(1, 3))
            for axis in range(2):
                beyond = np.roll(coarse, -1, axis)  # the margin is empty: nothing comes round
                coarse = np.maximum(coarse, beyond)
            levels.append(coarse)
        return cls(origin, tuple(levels))

    def scores(self, level: int, cell: np.ndarray) -> np.ndarray:
        """Sums over points that lie in `cell` `(n, points, 2)` of a level or a few cells on.

        The result is `(n, FACTOR, FACTOR)`: one for each shift by less than FACTOR cells. What
        lies outside ends on the raster's border, which is empty.
        """
        raster = self.levels[level]
        steps = np.arange(FACTOR, dtype=np.int32)[:, None]
        x, y = (
            np.clip(cell[:, None, :, axis] + steps, 0, raster.shape[axis] - 1) for axis in range(2)
        )
        index = x[:, :, None] * np.int32(raster.shape[1]) + y[:, None]
        return raster.ravel()[index].sum(axis=-1)


def match(raster: Raster, points: np.ndarray) -> tuple[np.ndarray, float]:
    """`T_ref_query` in metres and radians of the best alignment, and its score in [0, 1].

    `points` `(points, 2)` are the query's end points in metres. A candidate is a rotation and a
    square of translations, with a bound for the scores of all of them; those of the highest bound
    are divided first, and whatever cannot beat the best score so far is left out.
    """
    turns = np.arange(0.0, 2 * np.pi, TURN)
    cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
    x, y = points.T
    turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    # Cells of the finest level, at the translation (-REACH, -REACH) that shifts count from.
    placed = np.floor((turned - raster.origin - REACH) / CELL).astype(np.int32)
    pyramid = [placed // FACTOR**level for level in range(LEVELS)]
    bounds = _coarse_scores(raster.levels[-1], pyramid[-1])

    def look(flat: np.ndarray, best: tuple[float, np.ndarray]) -> tuple[float, np.ndarray]:
        candidates = np.stack(np.unravel_index(flat, bounds.shape), axis=-1)
        return _divided(raster, pyramid, candidates, best)

    first = np.argpartition(bounds.ravel(), -_BATCH)[-_BATCH:]
    best = look(first, (-1.0, np.zeros(3, int)))
    left = np.flatnonzero(bounds.ravel() > best[0])
    left = left[np.argsort(-bounds.ravel()[left])]
    for start in range(0, len(left), _BATCH):
        if bounds.ravel()[left[start]] <= best[0]:
            break
        best = look(left[start : start + _BATCH], best)
    score, (turn, i, j) = best
    theta = (turns[turn] + np.pi) % (2 * np.pi) - np.pi
    return np.array([i * CELL - REACH, j * CELL - REACH, theta]), score / len(points)


def _coarse_scores(top: np.ndarray, placed: np.ndarray) -> np.ndarray:
    """Bounds `(turns, cells, cells)` of every rotation and every coarse cell of translations.

    `placed` `(turns, points, 2)` are coarse cells of the points.
    """
    count = int(np.ceil(2 * REACH / (CELL * FACTOR ** (LEVELS - 1)))) + 1
    low = np.minimum(placed.min(axis=(0, 1)), 0)
    high = np.maximum(placed.max(axis=(0, 1)) + count, top.shape)
    wide = np.pad(top, [(-low[k], high[k] - top.shape[k]) for k in range(2)])
    bounds = np.zeros((len(placed), count, count), np.float32)
    for bound, cells in zip(bounds, placed - low, strict=True):
        # Translations shift the raster under the points: one slice for each distinct cell.
        flat, times = np.unique(cells[:, 0] * wide.shape[1] + cells[:, 1], return_counts=True)
        for at, weight in zip(flat.tolist(), times.tolist(), strict=True):
            a, b = divmod(at, wide.shape[1])
            bound += weight * wide[a : a + count, b : b + count]
    return bounds


def _divided(
    raster: Raster,
    pyramid: list[np.ndarray],
    candidates: np.ndarray,
    best: tuple[float, np.ndarray],
) -> tuple[float, np.ndarray]:
    """The best of `best` and of all that `candidates` lead to: their turns and coarse cells."""
    scores = np.zeros(0)
    for level in reversed(range(LEVELS - 1)):
        turn, shift = candidates[:, 0], FACTOR * candidates[:, 1:].astype(np.int32)
        scores = raster.scores(level, pyramid[level][turn] + shift[:, None])
        found, i, j = np.nonzero(scores > best[0])
        if len(found) == 0:
            return best
        candidates = np.column_stack([turn[found], shift[found] + np.column_stack([i, j])])
        scores = scores[found, i, j]
    winner = np.argmax(scores)
    return float(scores[winner]), candidates[winner]
