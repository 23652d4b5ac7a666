import numpy as np
import pytest

from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.grid.viewpoints import viewpoints


def rooms(pose=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    """Two rooms of 6 m x 4 m with a wall between, and a door of 1 m in it."""
    cells = np.zeros((44, 124))
    cells[[0, 1, -2, -1]], cells[:, [0, 1, -2, -1]] = 100, 100
    cells[:, 61:63] = 100
    cells[20:30, 61:63] = 0
    return OccupancyGrid.make(cells, 0.1, pose)


def sees(grid: OccupancyGrid, a: np.ndarray, b: np.ndarray) -> bool:
    """Whether all cells on the line from a to b, in metres in the grid's frame, are free."""
    share = np.linspace(0, 1, 200)[:, None]
    x, y = np.floor((a + share * (b - a)) / grid.resolution).astype(int).T
    return bool(grid.free[y, x].all())


@pytest.mark.parametrize("distance", [1.0, 2.0, 4.0])
def test_every_place_of_the_floor_is_near_a_viewpoint_that_sees_it(distance):
    grid = rooms()
    xy = viewpoints(grid, distance=distance, clearance=0.4)
    rng = np.random.default_rng(0)
    for place in rng.uniform([0.6, 0.6], [11.8, 3.8], (300, 2)):
        if 5.6 < place[0] < 6.8:
            continue  # at the wall between the rooms
        # The candidates of which all are covered lie up to a square's diagonal away.
        near = xy[np.hypot(*(xy - place).T) <= distance + 0.75]
        assert any(sees(grid, viewpoint, place) for viewpoint in near)


def test_places_keep_clear_of_walls_and_lie_on_free_cells():
    grid = rooms()
    xy = viewpoints(grid, clearance=0.4)
    walls = (np.argwhere(grid.occupied)[:, ::-1] + 0.5) * grid.resolution
    gap = np.hypot(*(xy[:, None] - walls).transpose(2, 0, 1)).min(axis=1)
    assert gap.min() >= 0.4 - 1e-9


def test_a_larger_distance_takes_fewer_places_and_two_rooms_take_two():
    counts = [len(viewpoints(rooms(), distance=d)) for d in (1.0, 2.0, 8.0)]
    assert counts[0] > counts[1] > counts[2] >= 2


def test_the_same_places_every_time_and_in_the_world():
    here = viewpoints(rooms())
    np.testing.assert_array_equal(viewpoints(rooms()), here)
    there = viewpoints(rooms(pose=(10.0, -5.0, np.pi / 2)))
    np.testing.assert_allclose(there, np.array([10.0, -5.0]) + here[:, ::-1] * [-1, 1], atol=1e-9)


def test_a_corridor_narrower_than_the_spacing_has_places_too():
    cells = np.full((60, 60), -1)
    cells[:, 28:36] = 100
    cells[:, 29:35] = 0
    xy = viewpoints(OccupancyGrid.make(cells, 0.1), clearance=0.2, spacing=2.0, distance=1.5)
    assert len(xy) >= 2


def test_a_spacing_larger_than_the_grid_leaves_one_candidate():
    assert len(viewpoints(rooms(), spacing=1e300)) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"distance": 0.0}, "distance: 0.0 m"),
        ({"spacing": np.inf}, "spacing: inf m"),
        ({"clearance": -1.0}, "clearance: -1.0 m"),
        ({"clearance": 5.0}, "clearance: no cell has 5.0 m"),
    ],
)
def test_what_makes_no_sense_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        viewpoints(rooms(), **options)
