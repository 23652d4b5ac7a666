"""Two scans aligned from a rough idea of their relative pose."""

import jax
import numpy as np
import pytest

from aprjax.configuration import Packed
from aprjax.features import FeatureConfig
from aprjax.plane import compose, relative
from aprjax.tracking.views import view_of
from aprjax.world.alignment import AlignConfig, align_pairs, align_two
from aprjax.world.motion import turned
from tests.worlds import free_pose, office, scan_at

TURNS = np.radians([0, -10, 10])
OFF = np.array([0.15, -0.1, 0.15])


@pytest.fixture(scope="module")
def drive():
    """Two scans half a metre and 11° apart, and that step."""
    rng, world = np.random.default_rng(3), office(seed=1)
    before = free_pose(world, rng)
    now = compose(before, np.array([0.4, 0.3, 0.2]))
    scans = [scan_at(world, pose, rng=rng) for pose in (before, now)]
    return [view_of(scan, Packed.of(FeatureConfig())) for scan in scans], relative(before, now)


def test_one_pair_by_itself_is_aligned_as_among_others(drive):
    views, T_first_second = drive
    start = T_first_second + OFF
    alone = align_two(*views, turned(start, TURNS), Packed.of(AlignConfig()))
    stacked = jax.tree.map(lambda *pair: np.stack(pair), *views)
    among = align_pairs(
        stacked,
        np.array([1, 0]),
        np.array([0, 1]),
        turned(np.stack([start, start]), TURNS),
        np.ones(3),
        AlignConfig(),
    )
    np.testing.assert_allclose(alone.T_first_second, among.T_first_second[1], atol=1e-4)
    np.testing.assert_allclose(alone.covariance, among.covariance[1], rtol=0.02, atol=1e-9)
    np.testing.assert_allclose(alone.agreement, among.agreement[1], atol=0.02)


def test_a_pair_is_aligned_to_centimetres_from_decimetres_off(drive):
    views, T_first_second = drive
    start = T_first_second + OFF
    found = align_two(*views, turned(start, TURNS), Packed.of(AlignConfig()))
    np.testing.assert_allclose(found.T_first_second[:2], T_first_second[:2], atol=0.03)
    assert abs(found.T_first_second[2] - T_first_second[2]) < np.radians(0.5)
    assert found.agreement > 0.3
