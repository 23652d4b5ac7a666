import jax
import numpy as np
import pytest

from aprjax.anchors.extract import ExtractionConfig
from aprjax.anchors.surface import SurfaceConfig
from aprjax.scan import Scan
from tests.anchors.shapes import polyline, room, turn_at
from tests.oracles import anchors as oracle
from tests.oracles.alignment import apart
from tests.worlds import scan_at

SCANS = {
    "closed room": turn_at(room(6, 4), (0.5, 0.3, 0.2), noise=0.01),
    "half turn": scan_at(room(7, 5), np.array([1.0, -0.5, 0.4]), beams=181),
    "coarse": scan_at(room(7, 5), np.array([1.0, -0.5, 0.4]), beams=31),
    "a convex corner and an end": turn_at(
        polyline((1.5, -1.5), (0.9, 0.0), (1.5, 1.5)), np.zeros(3), noise=0.004
    ),
}


def check(scan, config, stages):
    """Each side of each hit against the oracle; returns how many lines were compared."""
    beams = oracle.Beams(
        scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max
    )
    segments, compared = stages.segments, 0
    window, spacings = float(config.window), float(config.spacings)
    for start in np.flatnonzero(segments.hit & (segments.before == 0)):
        entries = range(start, start + segments.after[start] + 1)
        part = [int(segments.beam[k]) for k in entries]
        for place, entry in enumerate(entries):
            before, after = (
                oracle.side(beams, part, place, sign, window, spacings, config.samples)
                for sign in (-1, 1)
            )
            for points, face in (
                (before, stages.surface.before),
                (after, stages.surface.after),
                ([*before, beams.xy[part[place]], *after], stages.surface.through),
            ):
                assert face.count[entry] == len(points)
                if len(points) < 2:
                    continue
                centre, direction, spread, rms = oracle.line(points)
                np.testing.assert_allclose(face.centre[entry], centre, atol=1e-4)
                assert face.spread[entry] == pytest.approx(spread, abs=2e-4)
                assert face.rms[entry] == pytest.approx(rms, abs=4e-4)
                if spread > 3 * rms + 1e-3:
                    gap = apart(float(face.direction[entry]), direction, np.pi)
                    assert gap < 2e-4 / (spread - rms)
                compared += 1
    return compared


@pytest.mark.parametrize("name", SCANS)
def test_lines_equal_the_oracle(extraction, name):
    compared = check(SCANS[name], SurfaceConfig(), extraction(SCANS[name]))
    assert compared > 2 * np.isfinite(SCANS[name].ranges).sum()


def test_lines_equal_the_oracle_with_another_window(extraction):
    config = SurfaceConfig(window=0.9, spacings=5.0)
    scan = SCANS["half turn"]
    check(scan, config, extraction(scan, ExtractionConfig(surface=config)))


def test_a_wall_has_the_same_direction_to_both_sides_and_through_every_hit(extraction):
    stages = extraction(scan_at(polyline((2, -2), (2.5, 2)), np.zeros(3), beams=181))
    expected = np.arctan2(4, 0.5)
    faces = stages.surface
    for face in (faces.before, faces.after, faces.through):
        real = (face.count >= 3) & stages.segments.hit
        assert real.sum() > 80
        gaps = [apart(float(angle), expected, np.pi) for angle in face.direction[real]]
        assert max(gaps) < 2e-3
        assert face.rms[real].max() < 2e-3


def test_entries_that_are_no_hit_use_no_hits(extraction):
    stages = extraction(scan_at(polyline((2, -1), (2, 1)), np.zeros(3), beams=181))
    faces = stages.surface
    for face in (faces.before, faces.after, faces.through):
        assert not face.count[~stages.segments.hit].any()


def test_a_line_across_the_cut_of_a_closed_room_is_still_fitted_to_one_side(extraction):
    stages = extraction(SCANS["closed room"])
    assert (stages.surface.before.count + stages.surface.after.count >= 3)[:384].all()


def test_faces_do_not_depend_on_padding_where_a_narrow_view_has_beams_close_together(extraction):
    wall = scan_at(polyline((0.6, -3), (0.6, 3)), np.zeros(3), beams=181)
    step = np.radians(45) / 180
    near = Scan.make(
        0.6 / np.cos(-np.radians(22.5) + step * np.arange(181)),
        angle_min=-np.radians(22.5),
        angle_increment=step,
        range_max=float(wall.range_max),
    )
    few, many = (extraction(near, slots=slots).surface for slots in (192, 384))
    for side in ("before", "after", "through"):
        for one, other in zip(
            *(jax.tree.leaves(getattr(s, side)) for s in (few, many)), strict=True
        ):
            np.testing.assert_allclose(one[:181], other[:181], atol=1e-6)
