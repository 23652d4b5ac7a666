"""Where to take reference scans in an occupancy grid: few places from which all is seen."""

import numpy as np
import scipy

from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.grid.rendering import render
from aprjax.scan import Scan

_RAYS = 180  # lines of sight looked along from each place


def viewpoints(
    grid: OccupancyGrid,
    *,
    distance: float = 2.0,
    clearance: float = 0.3,
    spacing: float = 0.5,
) -> np.ndarray:
    """Places `(N, 2)` in the world, in metres, that cover the free floor; the same every time.

    Candidates lie every `spacing` metres where there is `clearance` metres of free floor all
    around. A place covers those within `distance` metres that it sees. Greedy set cover: the
    place that covers most of what is not covered yet comes next, of several the one farthest from
    any wall, then the first by rows. Raises `ValueError` naming a length that is not positive and
    finite, and for a grid without any candidate.
    """
    for name, value in (("distance", distance), ("clearance", clearance), ("spacing", spacing)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name}: {value} m is not positive and finite")
    index, room = _candidates(grid, clearance, spacing)
    if not len(index):
        raise ValueError(f"clearance: no cell has {clearance} m of free floor all around")
    xy = grid.centres(index)
    return xy[_cover(_seen(grid, xy, distance), room)]


def _candidates(
    grid: OccupancyGrid, clearance: float, spacing: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the candidates `(n, 2)`, and their distances in metres from any wall.

    One for each square of the spacing: its cell of most room. So doorways and corridors that are
    narrower than the spacing have some too.
    """
    free = np.pad(grid.free, 1)  # beyond the grid, nothing is
    room = np.asarray(scipy.ndimage.distance_transform_edt(free, sampling=grid.resolution))
    room = room[1:-1, 1:-1]
    size = max(round(min(spacing / grid.resolution, max(grid.cells.shape))), 1)
    index = np.argwhere(room >= clearance)
    room = room[tuple(index.T)]
    square = (index // size) @ np.array([grid.cells.shape[1], 1])
    order = np.lexsort((index[:, 1], index[:, 0], -room, square))
    best = order[np.r_[True, np.diff(square[order]) > 0]] if len(order) else order
    return index[best], room[best]


def _seen(grid: OccupancyGrid, xy: np.ndarray, distance: float) -> list[np.ndarray]:
    """For each place, the numbers of those within `distance` in its line of sight, ascending."""
    step = 2 * np.pi / _RAYS
    like = Scan.make(
        np.zeros(_RAYS), angle_min=-np.pi, angle_increment=step, range_max=distance + step
    )
    poses = np.column_stack([xy, np.zeros(len(xy))])
    depth = np.asarray(render(grid, poses, like).ranges)
    near = scipy.spatial.KDTree(xy).query_ball_point(xy, distance, return_sorted=True)
    seen = []
    for place, others in enumerate(near):
        others = np.asarray(others)
        off = xy[others] - xy[place]
        beam = np.round((np.arctan2(off[:, 1], off[:, 0]) + np.pi) / step).astype(int) % _RAYS
        # A comparison with NaN, an unknown cell in the way, is false.
        seen.append(others[(np.hypot(*off.T) <= depth[place, beam]) | (others == place)])
    return seen


def _cover(seen: list[np.ndarray], room: np.ndarray) -> np.ndarray:
    """The places that greedy set cover takes, in the order taken."""
    count = np.array([len(others) for others in seen], float)
    # Sight goes both ways up to rounding: what a place newly covers changes for those that see it.
    seen_by: list[list[int]] = [[] for _ in seen]
    for place, others in enumerate(seen):
        for other in others:
            seen_by[other].append(place)
    covered = np.zeros(len(seen), bool)
    order = np.lexsort((np.arange(len(room)), -room))
    taken = []
    while not covered.all():
        place = order[np.argmax(count[order])]
        taken.append(place)
        for other in seen[place][~covered[seen[place]]]:
            covered[other] = True
            count[seen_by[other]] -= 1
    return np.array(taken)
