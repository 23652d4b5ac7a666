"""The looks of a floor: paint, posters, coloured doors and furniture, drawn from a seed."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aprjax.sim.floor_plan import FloorPlan

ROOM_HEIGHT = 2.6
"""Metres from floor to ceiling."""
FLOOR, CEILING = np.array([0.35, 0.32, 0.30]), np.array([0.85, 0.85, 0.82])
_CELL = 1.4  # metres of wall on which there is one poster or none
_POSTERS = 0.55  # share of them that have one
_SKIRTING = 0.12  # metres
_DARK = np.array([0.25, 0.22, 0.2])


@dataclass(frozen=True)
class Textures:
    """Colours from 0 to 1 (red, green, blue) of a floor's surfaces, by their numbers in its plan.

    They stay with the surfaces when the floor is `rearranged`.
    """

    paint: np.ndarray
    """`(T, 3)` of walls, then doors."""
    poster: np.ndarray
    """`(T, cells, 3)` of what hangs on each cell of a wall; NaN where nothing does."""
    poster_span: np.ndarray
    """`(T, cells, 2, 2)`: along the cell and up the wall, from where to where in metres."""
    furniture: np.ndarray
    """`(P, 3)` of each piece."""
    furniture_height: np.ndarray
    """`(P,)` metres."""

    @classmethod
    def draw(cls, seed: int, plan: FloorPlan) -> Self:
        """The textures of a plan; the same seed gives the same colours."""
        rng = np.random.default_rng(seed)
        walls, doors, pieces = len(plan.walls), len(plan.doors), len(plan.furniture)
        length = np.hypot(*(plan.walls[:, 1] - plan.walls[:, 0]).T)
        cells = int(np.max(length, initial=0.0) / _CELL) + 1
        shape = (walls + doors, cells)
        grey = rng.uniform(0.6, 0.95, (walls, 1))
        paint = np.clip(grey + rng.normal(0, 0.06, (walls, 3)), 0, 1)
        poster = rng.uniform(0, 1, (*shape, 3))
        bare = rng.random(shape) > _POSTERS
        bare[walls:] = True
        poster[bare] = np.nan
        left, low = rng.uniform(0.05, 0.4, shape), rng.uniform(0.6, 1.3, shape)
        right, high = left + rng.uniform(0.4, 0.95, shape), low + rng.uniform(0.3, 0.9, shape)
        return cls(
            paint=np.concatenate([paint, rng.uniform(0.1, 0.9, (doors, 3))]),
            poster=poster,
            poster_span=np.stack(
                [np.stack([left, right], axis=-1), np.stack([low, high], axis=-1)], axis=-2
            ),
            furniture=rng.uniform(0.05, 0.9, (pieces, 3)),
            furniture_height=rng.choice([0.72, 1.1, 1.9], pieces, p=[0.5, 0.25, 0.25]),
        )

    def wall(self, index: np.ndarray, along: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Colours `(rows, columns, 3)` of walls or doors `index` `(columns,)`.

        `along` `(columns,)` are metres from the surface's start, `height` `(rows, columns)` metres
        above the floor.
        """
        cell = np.minimum((along / _CELL).astype(int), self.poster.shape[1] - 1)
        within = along - cell * _CELL
        (left, right), (low, high) = np.moveaxis(self.poster_span[index, cell], 0, -1)
        colour = self.poster[index, cell]
        hung = ~np.isnan(colour[:, 0]) & (within >= left) & (within < right)
        image = np.broadcast_to(self.paint[index], (*height.shape, 3)).copy()
        image[height < _SKIRTING] = _DARK
        shown = hung & (height >= low) & (height < high)
        return np.where(shown[..., None], colour, image)
