"""A floor as square cells: occupied, free or unknown."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from aprjax.plane import transform

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
MOST_CELLS = 1 << 28
"""Of the largest grid, half a square kilometre at 5 cm: more is a mistake, or meant to do harm."""
FINEST, COARSEST = 1e-4, 1e3
"""Metres that a cell is wide at least and at most."""
_FREE_TO, _OCCUPIED_FROM = 25, 65  # per cent, as map_server's thresholds are by default


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A grid in the world, in the terms of ROS's `nav_msgs/OccupancyGrid`.

    Cell `[row, column]` spans `x` from `column * resolution` and `y` from `row * resolution` in
    the grid's own frame: row 0 is the lowest.
    """

    cells: np.ndarray
    """`(rows, columns)` of int8: 0 (free) to 100 (occupied) per cent, -1 where unknown."""
    resolution: float
    """Metres a cell is wide."""
    T_world_grid: np.ndarray
    """`(3,)` in metres and radians: the outer corner of cell `[0, 0]`, and where x points."""

    @classmethod
    def make(
        cls,
        cells: np.ndarray,
        resolution: float,
        T_world_grid: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    ) -> Self:
        """A checked grid.

        Raises `ValueError` naming the field and its value for cells that are not two-dimensional,
        none, over 2²⁸ or not from -1 to 100, for a resolution that is not from 0.1 mm to 1 km, and
        for a pose that is not three finite numbers.
        """
        given = np.asarray(cells)
        if given.ndim != 2 or given.size == 0:
            raise ValueError(f"cells: shape {given.shape} is not (rows, columns) of at least one")
        if given.size > MOST_CELLS:
            raise ValueError(f"cells: {given.size} are more than {MOST_CELLS}")
        wrong = np.argwhere(~((given >= UNKNOWN) & (given <= OCCUPIED)))
        if wrong.size:
            index = tuple(wrong[0].tolist())
            raise ValueError(f"cells{list(index)}: {given[index]} is not from -1 to 100")
        if not FINEST <= resolution <= COARSEST:
            raise ValueError(f"resolution: {resolution} m is not from {FINEST} to {COARSEST}")
        pose = np.array(T_world_grid, float)
        if pose.shape != (3,) or not np.isfinite(pose).all():
            raise ValueError(f"T_world_grid: {T_world_grid} is not three finite numbers")
        return cls(given.astype(np.int8), float(resolution), pose)

    @property
    def occupied(self) -> np.ndarray:
        """Mask `(rows, columns)`: 65 % and more."""
        return self.cells >= _OCCUPIED_FROM

    @property
    def free(self) -> np.ndarray:
        """Mask `(rows, columns)`: known, and at most 25 %."""
        return (self.cells >= FREE) & (self.cells <= _FREE_TO)

    def centres(self, index: np.ndarray) -> np.ndarray:
        """Centres `(n, 2)` in the world, in metres, of the cells `(n, 2)` of row and column."""
        xy_grid = (np.asarray(index)[:, ::-1] + 0.5) * self.resolution
        return transform(self.T_world_grid, xy_grid)
