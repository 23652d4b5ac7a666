import jax
import numpy as np
import pytest

from aprjax.sim.drive import drive
from aprjax.sim.floor_plan import office
from aprjax.sim.lab import choose_references, lab
from aprjax.sim.laser import Laser
from aprjax.sim.odometry import OdometryConfig
from aprjax.sim.run import simulate

REFERENCES, QUERIES = 6, 50


@pytest.fixture(scope="module")
def built():
    return lab(0, REFERENCES, QUERIES, Laser.sick(1.0))


def test_a_lab_has_the_scans_asked_for_and_all_that_belongs_to_them(built):
    for run, count in ((built.references, REFERENCES), (built.queries, QUERIES)):
        assert run.scans.ranges.shape == (count, 181)
        assert run.T_world_laser.shape == run.odometry.shape == (count, 3)
        assert run.gyro.shape == run.stamps.shape == (count,)
        assert np.mean(np.asarray(run.scans.hit)) > 0.9


def test_the_same_seed_gives_the_same_bits_and_another_seed_another_lab(built):
    again = lab(0, REFERENCES, QUERIES, Laser.sick(1.0))
    leaves = jax.tree.leaves(again.queries.scans), jax.tree.leaves(built.queries.scans)
    for a, b in zip(*leaves, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(again.queries.odometry, built.queries.odometry)
    other = lab(1, REFERENCES, QUERIES, Laser.sick(1.0))
    assert not np.array_equal(other.queries.scans.ranges, built.queries.scans.ranges)


def test_the_references_are_scans_of_the_first_run(built):
    first = built.reference_run
    rows = [
        int(np.flatnonzero(np.all(first.T_world_laser == pose, axis=1))[0])
        for pose in built.references.T_world_laser
    ]
    assert rows == sorted(set(rows))
    np.testing.assert_array_equal(
        built.references.scans.ranges, np.asarray(first.scans.ranges)[rows]
    )


def test_the_second_run_goes_other_ways_through_changed_surroundings(built):
    assert not np.array_equal(built.queries.world.segments, built.reference_run.world.segments)
    gap = np.linalg.norm(
        built.queries.T_world_laser[:, None, :2] - built.references.T_world_laser[None, :, :2],
        axis=-1,
    )
    assert np.all(gap > 0)


def test_references_are_chosen_where_they_serve_most_poses():
    """Many poses at three places, one far off: one reference at each, the lone one last."""
    rng = np.random.default_rng(0)
    places = np.repeat([(0, 0, 0), (10, 0, 0), (0, 0, np.pi)], [30, 20, 10], axis=0).astype(float)
    poses = np.concatenate([places + rng.normal(0, 0.05, places.shape), [(40.0, 0, 0)]])
    chosen = choose_references(poses, 3)
    assert [np.searchsorted([30, 50, 60], row, side="right") for row in chosen] == [0, 1, 2]
    assert 60 in choose_references(poses, 4)


def test_impossible_numbers_are_refused_by_name_and_value():
    with pytest.raises(ValueError, match="references: 0"):
        lab(0, 0)
    with pytest.raises(ValueError, match="queries: -1"):
        lab(0, 5, -1)


def test_a_run_of_an_exact_scanner_lies_on_the_surfaces_of_its_world():
    plan = office(0, visited=2)
    poses, stamps = drive(0, plan, 12, 0.5)
    laser = Laser.sick(1.0, bias=0.0, noise=0.0, noise_per_metre=0.0, dropout=0.0, mixed=0.0)
    run = simulate(0, plan, poses, stamps, laser, people=0, errors=OdometryConfig.exact())
    segments = np.asarray(run.world.segments, float)
    circles = np.asarray(run.world.circles, float)
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    for pose, ranges in zip(poses, np.asarray(run.scans.ranges), strict=True):
        angles = pose[2] - np.pi / 2 + np.radians(1) * np.arange(181)
        points = pose[:2] + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        share = np.clip(((points[:, None] - start) * along).sum(-1) / square, 0, 1)
        wall = np.linalg.norm(start + share[..., None] * along - points[:, None], axis=-1)
        ring = np.abs(np.linalg.norm(points[:, None] - circles[:, :2], axis=-1) - circles[:, 2])
        off = np.minimum(wall.min(axis=1), ring.min(axis=1, initial=np.inf))
        assert np.nanmax(off) < 0.5 * float(laser.resolution) + 1e-3
