"""Surfaces across beams without a reading; the parts themselves are held in test_segment."""

import numpy as np
import pytest

from aprjax.anchors.segment import SegmentConfig
from tests.anchors.shapes import polyline, rebuilt, room, turn_at
from tests.oracles import anchors as oracle
from tests.worlds import free_pose, office, scan_at

OFFICE = office(5)


def without(scan, beams, reading=np.nan):
    ranges = np.array(scan.ranges)
    ranges[beams] = reading
    return rebuilt(scan, ranges)


def points(extraction, scan, config=None):
    """Hits `(beams, 2)` in the order of the beams; zero where there is none."""
    segments = extraction(scan, config).segments
    xy = np.zeros_like(segments.xy)
    xy[segments.beam] = segments.xy
    return xy


@pytest.mark.parametrize("seed", range(4))
def test_filled_readings_equal_the_oracle(extraction, seed):
    rng = np.random.default_rng(seed)
    scan = turn_at(OFFICE, free_pose(OFFICE, rng), beams=360, noise=0.01, seed=seed)
    scan = without(scan, rng.random(360) < 0.3)
    config = SegmentConfig()
    beams = oracle.Beams(
        scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max
    ).bridged(float(config.bridge), float(config.gap), float(config.incidence))
    assert sum(beams.hit) > scan.hit.sum() + 30
    np.testing.assert_allclose(points(extraction, scan)[:360], beams.xy, atol=2e-4)


def test_a_wall_with_missing_readings_is_the_same_wall(extraction):
    wall = scan_at(polyline((2, -3), (2.5, 3)), np.zeros(3), beams=91)
    holes = without(wall, [30, 40, 41, 50, 51, 52])
    np.testing.assert_allclose(points(extraction, holes), points(extraction, wall), atol=1e-4)


def test_readings_are_filled_across_the_seam_of_a_full_turn(extraction):
    scan = turn_at(room(6, 4), (0.5, 0.3, 0.2), beams=360)
    holes = without(scan, [358, 359, 0])
    np.testing.assert_allclose(points(extraction, holes), points(extraction, scan), atol=1e-3)


@pytest.mark.parametrize(
    ("beams", "reading"),
    [([40, 41, 42, 43], np.nan), ([40], np.inf), ([40, 41], [np.nan, np.inf]), ([0, 90], np.nan)],
    ids=["a longer gap", "a free beam", "a free beam beside an invalid one", "the ends"],
)
def test_other_gaps_stay(extraction, beams, reading):
    wall = scan_at(polyline((2, -3), (2.5, 3)), np.zeros(3), beams=91)
    assert not points(extraction, without(wall, beams, reading))[beams].any()


def test_nothing_is_filled_between_two_surfaces(extraction):
    world = np.concatenate([polyline((2, -3), (2, 0)), polyline((7, 0), (7, 3))])
    scan = without(scan_at(world, np.zeros(3), beams=91), [45])
    assert not points(extraction, scan)[45].any()
