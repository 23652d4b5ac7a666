import equinox as eqx
import jax
import numpy as np
import pytest

import aprjax
from aprjax.grid.drawing import grid_from_scans
from aprjax.grid.rendering import render
from aprjax.scan import Scan
from tests.worlds import clearance, free_pose, office, scan_at


@pytest.fixture(scope="module")
def drive():
    """An office, scans from places all over it, and the grid that they draw."""
    world = office(seed=3)
    rng = np.random.default_rng(1)
    poses = np.array([free_pose(world, rng) for _ in range(80)])
    scans = Scan.stack([scan_at(world, pose, noise=0.01, rng=rng) for pose in poses])
    return world, poses, scans, grid_from_scans(scans, poses)


def test_what_is_occupied_lies_on_a_wall_and_what_is_free_on_none(drive):
    world, _, _, grid = drive
    rng = np.random.default_rng(0)
    for mask, low, high in ((grid.occupied, 0.0, 0.1), (grid.free, 0.0, np.inf)):
        xy = grid.centres(rng.permutation(np.argwhere(mask))[:400])
        gap = np.array([clearance(world, each) for each in xy])
        assert np.mean((gap >= low) & (gap <= high)) > 0.98
    inside = grid.centres(np.argwhere(grid.free))
    low, high = world.min(axis=(0, 1)), world.max(axis=(0, 1))
    assert np.mean(np.all((inside > low) & (inside < high), axis=1)) > 0.995


def test_walls_that_were_seen_are_drawn_without_gaps(drive):
    world, poses, _, grid = drive
    cells = np.argwhere(grid.occupied)
    seen = [
        pose[:2] + np.asarray(scan_at(world, pose).points) @ turn(pose[2]).T for pose in poses[:10]
    ]
    xy = np.concatenate(seen)
    near = np.abs(
        xy[:, None] / grid.resolution
        - grid.T_world_grid[:2] / grid.resolution
        - (cells[:, ::-1] + 0.5)
    )
    assert np.mean(near.max(axis=2).min(axis=1) < 2) > 0.95


def turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_references_look_as_the_users_scanner_does_and_all_around(drive):
    world, _, _, grid = drive
    like = scan_at(world, np.zeros(3) + 1.0)
    references = aprjax.ReferenceSet.from_occupancy_grid(grid, like=like, distance=4.0)
    T_world_ref = references.T_world_ref
    assert np.all(references.scans.beams == like.beams)
    assert len(references) % 5 == 0
    first = T_world_ref[:5]
    np.testing.assert_array_equal(first[:, :2], np.tile(first[:1, :2], (5, 1)))
    np.testing.assert_allclose(np.diff(first[:, 2]), 2 * np.pi / 5)


def test_a_beam_without_return_frees_its_way_and_an_invalid_one_says_nothing():
    angles = {"angle_min": -0.1, "angle_increment": 0.05, "range_max": 3.0}
    wall = Scan.make(np.full(5, 1.0), **angles)
    both = []
    for value in (np.inf, np.nan):
        open_ = Scan.make(np.full(5, value), **angles)
        poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi]])
        both.append(grid_from_scans(Scan.stack([open_, wall]), poses, reach=5.0))
    for grid, free in zip(both, (True, False), strict=True):
        column = int((0.0 - grid.T_world_grid[0]) / 0.05)
        row = int((0.0 - grid.T_world_grid[1]) / 0.05)
        ahead = grid.cells[row, column + 1 : column + 3]
        assert np.all(ahead == (0 if free else -1))
        assert grid.cells[row, column - 10] == 0


def test_the_direction_in_which_a_scanner_counts_makes_no_difference():
    world = office(seed=3)
    pose = np.array([12.0, 0.0, 0.3])
    scan = scan_at(world, pose)
    mirrored = Scan.make(
        np.asarray(scan.ranges)[::-1], angle_min=np.pi / 2, angle_increment=-np.pi / 180,
        range_max=30.0,
    )  # fmt: skip
    grids = [grid_from_scans(Scan.stack([each]), pose[None]) for each in (scan, mirrored)]
    assert grids[0].cells.shape == grids[1].cells.shape
    assert np.mean(grids[0].cells == grids[1].cells) > 0.999


ONE = Scan.stack([Scan.make([1.0, 1.0], angle_min=0.0, angle_increment=0.1, range_max=5.0)])


@pytest.mark.parametrize(
    ("scans", "poses", "options", "message"),
    [
        (ONE, np.zeros((2, 3)), {}, "T_world_laser: shape"),
        (ONE, np.array([[0, 0, np.inf]]), {}, r"T_world_laser\[0, 2\]: inf"),
        (ONE, np.zeros((1, 3)), {"resolution": 0.0}, "resolution: 0.0 m"),
        (ONE, np.zeros((1, 3)), {"resolution": 1e-9}, "resolution: 1e-09 m is not from 0.0001"),
        (ONE, np.zeros((1, 3)), {"resolution": 1e-4}, "resolution: .* is 300003 x 300003 cells"),
        (ONE, np.zeros((1, 3)), {"reach": 1e9}, "resolution: at 0.05 m, a reach of 1000000000.0"),
        (ONE, np.zeros((1, 3)), {"reach": 0.01}, "reach: 0.01 m"),
        (ONE, np.zeros((1, 3)), {"reach": 0.5}, "scans: there is no hit within 0.5 m"),
        (
            eqx.tree_at(lambda s: s.ranges, ONE, ONE.ranges * np.nan),
            np.zeros((1, 3)),
            {},
            "no hit",
        ),
        (
            Scan.stack([Scan.make([1.0], angle_min=0.0, angle_increment=0.1, range_max=5.0)] * 2),
            np.array([[0, 0, 0], [1e6, 1e6, 0]]),
            {},
            "T_world_laser: the poses span",
        ),
        (
            Scan.stack([Scan.make([1.0], angle_min=0.0, angle_increment=0.1, range_max=5.0)] * 2),
            np.array([[0, 0, 0], [1e6, 0, 0]]),
            {},
            "T_world_laser: the poses span 2 x 20000022 cells",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(scans, poses, options, message):
    with pytest.raises(ValueError, match=message):
        grid_from_scans(scans, poses, **options)


def test_where_a_process_allows_64_bits_grids_and_rendered_scans_are_the_same(drive, wide):
    _, poses, scans, grid = drive
    like = jax.tree.map(lambda array: array[0], scans)
    rendered = render(grid, poses[:3], like)
    wide()
    np.testing.assert_array_equal(grid_from_scans(scans, poses).cells, grid.cells)
    jax.tree.map(np.testing.assert_array_equal, render(grid, poses[:3], like), rendered)
