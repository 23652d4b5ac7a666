import equinox as eqx
import jax
import numpy as np
import pytest

from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.grid.rendering import Cells, cast, render
from aprjax.scan import Scan

FULL = Scan.make(np.zeros(90), angle_min=-np.pi, angle_increment=np.pi / 45, range_max=20.0)
SMALL = Scan.make(np.zeros(5), angle_min=-0.2, angle_increment=0.1, range_max=3.0)


def room(rows=40, columns=60, resolution=0.1, pose=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    """Free floor in walls of one cell, with unknown cells around."""
    cells = np.zeros((rows, columns))
    cells[[0, -1]], cells[:, [0, -1]] = -1, -1
    cells[[1, -2], 1:-1], cells[1:-1, [1, -2]] = 100, 100
    return OccupancyGrid.make(cells, resolution, pose)


def marched(grid: OccupancyGrid, pose: np.ndarray, bearings: np.ndarray, range_max: float):
    """Ranges found by walking along each ray in steps of a thousandth of a cell."""
    step = grid.resolution / 1000
    way = step * np.arange(1, int(range_max / step))
    ranges = np.full(len(bearings), np.inf)
    for k, angle in enumerate(pose[2] + bearings):
        x = np.floor((pose[0] + way * np.cos(angle)) / grid.resolution).astype(int)
        y = np.floor((pose[1] + way * np.sin(angle)) / grid.resolution).astype(int)
        inside = (x >= 0) & (y >= 0) & (x < grid.cells.shape[1]) & (y < grid.cells.shape[0])
        cell = np.where(inside, grid.cells[y * inside, x * inside], -1)
        end = int(np.argmax(cell != 0))
        if cell[end] == 100:
            same = (x == x[end]) & (y == y[end])
            ranges[k] = way[same].mean()
        elif cell[end] == -1:
            ranges[k] = np.nan
    return ranges


@pytest.mark.usefixtures("nans")
@pytest.mark.parametrize("seed", range(5))
def test_ranges_are_those_of_walking_along_each_ray(seed):
    rng = np.random.default_rng(seed)
    grid = room()
    free = np.argwhere(grid.free)
    cells = grid.cells.copy()
    for value, count in ((100, 25), (-1, 8)):
        cells[tuple(free[rng.choice(len(free), count, replace=False)].T)] = value
    grid = OccupancyGrid.make(cells, grid.resolution)
    row, column = rng.permutation(np.argwhere(grid.free))[0]
    pose = np.array([(column + 0.37) * 0.1, (row + 0.61) * 0.1, rng.uniform(-3, 3)])
    # Without lines, a hit is the middle of the way through its cell.
    cells = Cells.of(grid)
    cells = eqx.tree_at(lambda c: c.surface.valid, cells, np.zeros_like(cells.surface.valid))
    bearings = np.asarray(FULL.bearings)
    in_cells = np.float32(pose / [0.1, 0.1, 1.0])
    ranges = 0.1 * np.asarray(jax.jit(cast)(cells, in_cells, bearings, np.float32(200.0)))
    expected = marched(grid, pose, bearings.astype(float), 20.0)
    # A ray through a corner may go either way round it.
    close = np.isclose(ranges, expected, atol=2e-3, equal_nan=True)
    assert close.mean() > 0.97
    assert np.isfinite(expected).any()


def test_a_hit_is_the_middle_of_the_wall_cell_and_only_within_the_limit():
    ranges = np.asarray(render(room(), np.array([[4.0, 2.0, 0.0]]), SMALL).ranges)[0]
    assert ranges[2] == pytest.approx(5.85 - 4.0, abs=1e-5)
    # The second is in the wall's cell before the limit, 3 m, and past it at the surface.
    for x in (2.0, 2.83):
        ranges = np.asarray(render(room(), np.array([[x, 2.0, 0.0]]), SMALL).ranges)[0]
        assert np.isposinf(ranges[2])


@pytest.mark.parametrize("thick", [0.1, 0.2])
@pytest.mark.parametrize("turn", [0.1, 0.3, 0.6, 1.2])
def test_a_wall_at_any_angle_is_seen_to_a_fifth_of_a_cell(turn, thick):
    normal = np.array([np.cos(turn), np.sin(turn)])
    row, column = np.indices((80, 80))
    off = (column + 0.5) * 0.1 * normal[0] + (row + 0.5) * 0.1 * normal[1] - 4.0 * normal.sum()
    cells = np.where(np.abs(off - 2.0) <= thick / 2, 100, np.where(off < 2.0, 0, -1))
    pose = np.array([[4.0, 4.0, turn]])
    scan = render(OccupancyGrid.make(cells, 0.1), pose, SMALL)
    expected = 2.0 / np.cos(np.asarray(SMALL.bearings))
    np.testing.assert_allclose(np.asarray(scan.ranges)[0], expected, atol=0.02)


def test_a_post_of_a_few_cells_and_a_corner_stay_where_they_are():
    cells = np.zeros((40, 40))
    cells[19:21, 30:32] = 100
    scan = render(OccupancyGrid.make(cells, 0.1), np.array([[1.0, 1.95, 0.0]]), SMALL)
    assert np.asarray(scan.ranges)[0, 2] == pytest.approx(2.05, abs=1e-4)


def test_along_the_axes_no_ray_leaves_its_row():
    grid = room()
    for quarter, expected in enumerate((3.85, 1.85, 1.85, 1.85)):
        pose = np.array([[2.0, 2.0, quarter * np.pi / 2]])
        ranges = np.asarray(render(grid, pose, FULL).ranges)[0]
        assert ranges[45] == pytest.approx(expected, abs=1e-4)


def test_unknown_cells_and_the_outside_say_nothing():
    cells = np.zeros((10, 60))
    cells[:, 30], cells[:, 40] = -1, 100
    grid = OccupancyGrid.make(cells, 0.1)
    poses = np.array([[2.0, 0.5, 0.0], [2.0, 0.5, np.pi], [4.02, 0.5, 0.0], [-3.0, 0.5, 0.0]])
    ranges = np.asarray(render(grid, poses, SMALL).ranges)[:, 2]
    assert np.isnan(ranges).all()


def test_where_the_grid_lies_in_the_world_changes_nothing():
    pose = np.array([2.0, 1.5, 0.4])
    here = render(room(), pose[None], FULL)
    origin = np.array([4e5, -3e6, 2.1])
    cos, sin = np.cos(origin[2]), np.sin(origin[2])
    x, y, theta = pose
    there = origin + np.array([cos * x - sin * y, sin * x + cos * y, theta])
    moved = render(room(pose=origin), there[None], FULL)
    np.testing.assert_allclose(np.asarray(moved.ranges), np.asarray(here.ranges), atol=1e-3)


def test_beams_and_limits_are_those_of_the_given_scan():
    scans = render(room(), np.array([[2.0, 2.0, 0.0]] * 40), SMALL.pad(8))
    assert np.shape(scans.ranges) == (40, 8)
    assert np.isnan(np.asarray(scans.ranges)[:, 5:]).all()
    for name in ("angle_min", "angle_increment", "range_min", "range_max", "beams"):
        np.testing.assert_array_equal(getattr(scans, name), np.full(40, getattr(SMALL, name)))


def test_what_says_nothing_is_nan_also_where_jax_looks_for_mistakes():
    poses = np.array([[4.5, 2.0, 0.0], [-5.0, 2.0, 0.0]])
    scans = render(room(), poses, SMALL.pad(8))
    with jax.debug_nans(True):
        again = render(room(), poses, SMALL.pad(8))
    np.testing.assert_array_equal(again.ranges, scans.ranges)
    assert np.isnan(scans.ranges[1]).all()
    assert np.isfinite(scans.ranges[0, :5]).all()


@pytest.mark.parametrize(
    ("poses", "like", "message"),
    [
        (np.zeros((0, 3)), SMALL, "T_world_laser: shape"),
        (np.zeros(3), SMALL, "T_world_laser: shape"),
        (np.array([[0, np.nan, 0]]), SMALL, r"T_world_laser\[0, 1\]: nan"),
        (np.zeros((1, 3)), Scan.stack([SMALL]), "like: ranges have shape"),
    ],
)
def test_what_makes_no_sense_is_refused(poses, like, message):
    with pytest.raises(ValueError, match=message):
        render(room(), poses, like)
