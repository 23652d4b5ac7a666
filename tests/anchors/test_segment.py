import numpy as np
import pytest

from aprjax.anchors.extract import ExtractionConfig
from aprjax.anchors.segment import SegmentConfig
from tests.anchors.shapes import FULL, SPACING, box, polyline, rebuilt, room, turn_at
from tests.oracles import anchors as oracle
from tests.worlds import free_pose, office, scan_at

CONFIG = SegmentConfig()
OFFICE = office(3)


def found_parts(segments):
    """{beams of the part in the order of the sweep: large} as the kernel has them."""
    parts = {}
    for entry in np.flatnonzero(segments.hit & (segments.before == 0)):
        members = range(entry, entry + segments.after[entry] + 1)
        flags = {bool(segments.large[k]) for k in members}
        assert len(flags) == 1
        assert [segments.before[k] for k in members] == list(range(len(members)))
        parts[tuple(int(segments.beam[k]) for k in members)] = flags.pop()
    return parts


def expected_parts(scan, config=CONFIG):
    beams = oracle.Beams(
        scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max
    ).bridged(
        *(float(value) for value in (config.bridge, config.dropout, config.gap, config.incidence))
    )
    found = oracle.parts(beams, float(config.gap), float(config.incidence))
    return {
        tuple(part): oracle.is_large(beams, part, float(config.min_extent), float(config.min_beams))
        for part in found
    }


def spoiled(scan, seed, share=0.1):
    """The scan with some beams of every kind that REP 117 knows."""
    rng = np.random.default_rng(seed)
    ranges = np.array(scan.ranges)
    bad = rng.random(len(ranges)) < share
    ranges[bad] = rng.choice([np.nan, np.inf, -np.inf, 0.0, -1.0, 99.0], bad.sum())
    return rebuilt(scan, ranges)


@pytest.mark.parametrize("seed", range(6))
def test_parts_equal_the_oracle_on_half_turns(extraction, seed):
    rng = np.random.default_rng(seed)
    scan = scan_at(OFFICE, free_pose(OFFICE, rng), beams=181 + seed, noise=0.01, rng=rng)
    assert found_parts(extraction(scan).segments) == expected_parts(scan)
    scan = spoiled(scan, seed)
    assert found_parts(extraction(scan).segments) == expected_parts(scan)


@pytest.mark.parametrize("seed", range(6))
def test_parts_equal_the_oracle_on_full_turns(extraction, seed):
    rng = np.random.default_rng(100 + seed)
    start, beams = rng.uniform(-4, 4), (FULL, 360, 271)[seed % 3]
    scan = turn_at(OFFICE, free_pose(OFFICE, rng), beams, start, noise=0.01, seed=seed)
    assert found_parts(extraction(scan).segments) == expected_parts(scan)
    scan = spoiled(scan, seed, share=0.03)
    assert found_parts(extraction(scan).segments) == expected_parts(scan)


def test_parts_equal_the_oracle_with_other_thresholds(extraction):
    config = SegmentConfig(gap=0.05, incidence=0.3, min_extent=0.8, min_beams=12)
    scan = turn_at(OFFICE, (5.0, 0.0, 0.3), noise=0.01)
    found = found_parts(extraction(scan, ExtractionConfig(segment=config)).segments)
    assert found == expected_parts(scan, config)
    assert found != expected_parts(scan)


def test_every_beam_is_kept_once_and_in_the_order_of_the_sweep(extraction):
    scan = turn_at(OFFICE, (5.0, 0.0, 0.3), beams=360)
    segments = extraction(scan).segments
    assert sorted(segments.beam[:360]) == list(range(360))
    assert set(np.diff(segments.beam[:360])) <= {1, -359}
    assert (segments.previous[1:360] == np.arange(359)).all()
    assert (segments.next[:359] == np.arange(1, 360)).all()
    assert (segments.previous[0], segments.next[359]) == (359, 0)


def test_the_ends_of_the_field_of_view_have_no_neighbour(extraction):
    scan = scan_at(room(6, 4), np.zeros(3), beams=181)
    segments = extraction(scan).segments
    assert (segments.previous[0], segments.next[180]) == (0, 180)


@pytest.mark.parametrize("start", np.arange(8) * np.pi / 4)
def test_a_wall_across_the_seam_is_one_part(extraction, start):
    wall = polyline((2, -1.5), (2, 1.5))  # seen around bearing 0
    parts = found_parts(extraction(turn_at(wall, np.zeros(3), start=start)).segments)
    assert len(parts) == 1
    (beams,) = parts
    assert len(beams) == int(2 * np.arctan2(1.5, 2) / SPACING) + 1


def test_the_seam_of_a_half_turn_joins_nothing(extraction):
    scan = scan_at(room(4, 4), np.zeros(3), beams=181, fov=1.9 * np.pi)
    (part,) = found_parts(extraction(scan).segments)
    assert part == tuple(range(181))


def test_both_ends_of_a_turn_reported_twice_join(extraction):
    step = 2 * np.pi / 360
    ranges = np.full(361, 2.0)
    scan = rebuilt(turn_at(room(4, 4), np.zeros(3)), ranges, -np.pi, step)
    (part,) = found_parts(extraction(scan).segments)
    assert len(part) == 360


def test_a_closed_room_is_one_part_of_all_beams(extraction):
    ((part, large),) = found_parts(
        extraction(turn_at(room(6, 4), (0.5, 0.3, 0.2), beams=360)).segments
    ).items()
    assert len(part) == 360
    assert large


def test_a_wall_at_grazing_incidence_stays_connected(extraction):
    wall = polyline((0.5, 0.6), (4.0, 0.6))
    assert len(found_parts(extraction(scan_at(wall, np.zeros(3), beams=361)).segments)) == 1


def test_small_is_decided_by_extent_not_by_the_number_of_beams(extraction):
    # A chair leg at 0.3 m covers more beams than a 0.4 m panel at 4 m.
    world = np.concatenate([box(0.3, 0, 0.1), polyline((0, 4), (0.4, 4))])
    parts = found_parts(extraction(turn_at(world, np.zeros(3))).segments)
    leg, panel = sorted(parts, key=len, reverse=True)
    assert len(leg) > 2 * len(panel)
    assert (parts[leg], parts[panel]) == (False, True)


def test_few_hits_far_apart_are_not_a_large_part(extraction):
    scan = rebuilt(scan_at(room(4, 4), np.zeros(3), beams=9), np.full(9, 0.25))
    parts = found_parts(extraction(scan).segments)
    assert not any(large for part, large in parts.items() if len(part) < 5)


def test_the_bearing_of_the_first_entry_is_that_of_its_beam(extraction):
    scan = turn_at(OFFICE, (5.0, 0.0, 0.3), beams=360)
    segments = extraction(scan).segments
    bearing = float(scan.angle_min) + int(segments.beam[0]) * float(scan.angle_increment)
    assert float(segments.angle_min) == pytest.approx(bearing, abs=1e-5)
