import numpy as np
import pytest

from aprjax.io.log import LogEntry
from aprjax.metrics import is_right
from experiments.particle_filter import CELL, LikelihoodField, ParticleFilter
from tests.worlds import free_pose, office, scan_at


@pytest.fixture(scope="module")
def floor():
    """A floor of 12 m, and the field of scans from all over it."""
    plan, rng = office(seed=3, length=12.0), np.random.default_rng(0)
    poses = np.array([free_pose(plan, rng) for _ in range(60)])
    return plan, LikelihoodField.of([scan_at(plan, pose) for pose in poses], poses)


def test_scans_end_where_the_field_is_highest(floor):
    plan, field = floor
    rng = np.random.default_rng(1)
    along = rng.uniform(size=(len(plan), 1))
    walls = plan[:, 0] + along * (plan[:, 1] - plan[:, 0])
    middle = np.median(field.of_ends(walls.astype(np.float32)))
    assert middle > np.median(field.of_ends(field.free.astype(np.float32))) + 1.0


def test_free_cells_lie_on_the_grid_and_off_the_walls(floor):
    _, field = floor
    cells = (field.free - field.origin) / CELL - 0.5
    np.testing.assert_allclose(cells, np.round(cells), atol=1e-6)
    assert len(field.free) * CELL**2 > 30.0


def drive(steps):
    """A way down the corridor with a turn into it."""
    return np.array([[2.0 + 0.25 * k, 0.1, 0.02 * k] for k in range(steps)])


def test_a_robot_is_found_from_anywhere_by_driving(floor):
    plan, field = floor
    made = ParticleFilter(field, 20_000, seed=0)
    entries = [LogEntry(scan_at(plan, pose), pose, 0.0, "", None, 1) for pose in drive(16)]
    *_, (pose, weight, _) = made.follow(entries)
    assert is_right(pose, drive(16)[-1])
    assert weight > 0.5


def test_weights_sum_to_one_and_the_same_seed_gives_the_same_bits(floor):
    plan, field = floor
    ends = []
    for _ in range(2):
        made = ParticleFilter(field, 500, seed=3)
        for pose in drive(4):
            made.move(pose)
            made.observe(scan_at(plan, pose))
        assert made.weights.sum() == pytest.approx(1.0)
        ends.append(made.poses)
    np.testing.assert_array_equal(*ends)
