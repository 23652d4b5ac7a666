"""Surfaces across beams without a reading; the parts themselves are held in test_segment."""

import numpy as np
import pytest

from aprjax.anchors.extract import ExtractionConfig
from aprjax.anchors.segment import SegmentConfig
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
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


def bridged(scan, config):
    """The beams as the oracle fills them in."""
    beams = oracle.Beams(
        scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max
    )
    return beams.bridged(
        *(float(value) for value in (config.bridge, config.dropout, config.gap, config.incidence))
    )


@pytest.mark.parametrize("seed", range(4))
def test_filled_readings_equal_the_oracle(extraction, seed):
    rng = np.random.default_rng(seed)
    scan = turn_at(OFFICE, free_pose(OFFICE, rng), beams=360, noise=0.01, seed=seed)
    scan = without(scan, rng.random(360) < 0.3)
    beams = bridged(scan, SegmentConfig())
    assert sum(beams.hit) > scan.hit.sum() + 30
    np.testing.assert_allclose(points(extraction, scan)[:360], beams.xy, atol=2e-4)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("dropout", [0.0, 0.036, 0.06])
def test_readings_filled_among_beams_without_return_equal_the_oracle(extraction, seed, dropout):
    rng = np.random.default_rng(seed)
    scan = turn_at(OFFICE, free_pose(OFFICE, rng), beams=360, noise=0.01, seed=seed)
    scan = without(scan, rng.random(360) < 0.2)
    scan = without(scan, rng.random(360) < 0.15, np.inf)
    config = SegmentConfig(dropout=dropout)
    beams = bridged(scan, config)
    filled = np.isposinf(scan.ranges) & beams.hit
    assert filled.sum() > 10 if dropout else not filled.any()
    described = ExtractionConfig(segment=config)
    np.testing.assert_allclose(points(extraction, scan, described)[:360], beams.xy, atol=2e-4)


def test_a_wall_with_missing_readings_is_the_same_wall(extraction):
    wall = scan_at(polyline((2, -3), (2.5, 3)), np.zeros(3), beams=181)
    holes = without(wall, [60, 80, 81, 100, 101, 102])
    np.testing.assert_allclose(points(extraction, holes), points(extraction, wall), atol=1e-4)


@pytest.mark.parametrize("reading", [np.inf, np.nan])
def test_readings_that_failed_are_filled_by_whatever_name_where_beams_are_dense(
    extraction, reading
):
    wall = scan_at(polyline((2, -3), (2.5, 3)), np.zeros(3), beams=361)
    lost = [120, 150, 151, 200]
    holes = without(wall, lost, reading)
    np.testing.assert_allclose(points(extraction, holes), points(extraction, wall), atol=1e-4)


def test_what_is_seen_through_an_opening_is_not_filled(extraction):
    wall = scan_at(polyline((2, -3), (2.5, 3)), np.zeros(3), beams=361)
    holes = without(wall, range(120, 126), np.inf)
    assert not points(extraction, holes)[120:126].any()


def test_readings_are_filled_across_the_seam_of_a_full_turn(extraction):
    scan = turn_at(room(6, 4), (0.5, 0.3, 0.2), beams=360)
    holes = without(scan, [358, 359, 0])
    np.testing.assert_allclose(points(extraction, holes), points(extraction, scan), atol=1e-3)


@pytest.mark.parametrize(
    ("beams", "reading"),
    [([80, 81, 82, 83], np.nan), ([80], np.inf), ([80, 81], [np.nan, np.inf]), ([0, 180], np.nan)],
    ids=["a longer gap", "a free beam", "a free beam beside an invalid one", "the ends"],
)
def test_other_gaps_stay(extraction, beams, reading):
    wall = scan_at(polyline((2, -3), (2.5, 3)), np.zeros(3), beams=181)
    assert not points(extraction, without(wall, beams, reading))[beams].any()


def test_nothing_is_filled_between_two_surfaces(extraction):
    world = np.concatenate([polyline((2, -3), (2, 0)), polyline((3, 0), (3, 3))])
    scan = without(scan_at(world, np.zeros(3), beams=181), [90])
    assert not points(extraction, scan)[90].any()


@pytest.mark.parametrize(
    ("ranges", "degrees"), [([np.nan, np.nan, 1.0, np.nan], 90), ([1.0, np.nan, np.nan, 1.0], 30)]
)
def test_nothing_is_filled_between_beams_far_apart(extraction, ranges, degrees):
    scan = Scan.make(ranges, angle_min=0.0, angle_increment=np.radians(degrees), range_max=30.0)
    segments = extraction(scan).segments
    assert segments.hit.sum() == np.isfinite(ranges).sum()
    assert not np.isinf(segments.range[:4]).any()


def test_what_was_filled_in_is_no_evidence():
    scan = without(scan_at(OFFICE, free_pose(OFFICE, np.random.default_rng(0))), range(0, 181, 4))
    view = ReferenceSet.build([scan]).index.features.view
    np.testing.assert_array_equal(np.asarray(view.hit)[0, :181], np.asarray(scan.hit))
    np.testing.assert_array_equal(np.asarray(view.range)[0, 0:181:4], 0)
    assert not np.any(np.asarray(view.linked)[0, :180] & ~np.asarray(scan.hit)[1:])
