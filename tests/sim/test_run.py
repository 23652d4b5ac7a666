import jax
import numpy as np
import pytest

from aprjax.plane import relative
from aprjax.sim.drive import drive
from aprjax.sim.floor_plan import office
from aprjax.sim.laser import Laser
from aprjax.sim.odometry import OdometryConfig
from aprjax.sim.run import simulate

SCANS = 60
LASER = Laser.sick(1.0)


@pytest.fixture(scope="module")
def plan():
    return office(3)


@pytest.fixture(scope="module")
def way(plan):
    return drive(1, plan, SCANS, 2.0)


@pytest.fixture(scope="module")
def run(plan, way):
    return simulate(5, plan, *way, LASER)


def ranges(run):
    return np.asarray(run.scans.ranges)


def test_a_run_keeps_the_truth_and_starts_its_own_frames_at_zero(run, way):
    np.testing.assert_array_equal(run.T_world_laser, way[0])
    np.testing.assert_array_equal(run.stamps, way[1])
    np.testing.assert_array_equal(run.odometry[0], 0)
    assert run.gyro[0] == 0
    assert ranges(run).shape == (SCANS, LASER.beams)


def test_the_same_seed_gives_the_same_bits_and_another_seed_other_noise(run, plan, way):
    again = simulate(5, plan, *way, LASER)
    for a, b in zip(jax.tree.leaves(run.scans), jax.tree.leaves(again.scans), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(run.odometry, again.odometry)
    np.testing.assert_array_equal(run.gyro, again.gyro)
    other = simulate(6, plan, *way, LASER)
    assert not np.array_equal(ranges(run), ranges(other))
    assert not np.array_equal(run.odometry[1:], other.odometry[1:])


def test_exact_wheels_restate_the_truth_whatever_the_scanner_sees(plan, way):
    exact = simulate(5, plan, *way, LASER, errors=OdometryConfig.exact())
    truth = relative(way[0][:1], way[0])
    np.testing.assert_allclose(exact.odometry[:, :2], truth[:, :2], atol=1e-9)
    turn = exact.odometry[:, 2] - truth[:, 2]
    np.testing.assert_allclose(np.sin(turn / 2), 0, atol=1e-9)


def test_people_only_ever_stand_before_what_else_would_be_seen(plan, way):
    """Same noise, so a beam differs only where a leg ends it, or mixes with what is behind."""
    quiet = Laser.sick(1.0, mixed=0.0, noise_per_metre=0.0, dropout=0.0)
    empty = ranges(simulate(5, plan, *way, quiet, people=0))
    busy = ranges(simulate(5, plan, *way, quiet, people=30))
    differs = empty != busy
    assert 0.001 < differs.mean() < 0.2
    assert np.all(busy[differs] < empty[differs])


def test_taking_scans_takes_all_that_belongs_to_them(run):
    rows = np.array([3, 10, 41])
    some = run.take(rows)
    np.testing.assert_array_equal(ranges(some), ranges(run)[rows])
    assert some.scans.beams.shape == (3,)
    for name in ("T_world_laser", "odometry", "gyro", "stamps"):
        np.testing.assert_array_equal(getattr(some, name), getattr(run, name)[rows])
    assert some.world is run.world


def test_stamps_that_do_not_fit_are_refused(plan, way):
    with pytest.raises(ValueError, match=r"stamps: shape \(59,\) does not fit 60 poses"):
        simulate(0, plan, way[0], way[1][1:], LASER)
