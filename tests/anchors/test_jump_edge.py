import numpy as np
import pytest

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import ExtractionConfig
from aprjax.anchors.jump_edge import JumpEdgeConfig
from tests.anchors.shapes import (
    FULL,
    SPACING,
    assert_same_points,
    box,
    distance_to,
    points_of,
    polyline,
    rebuilt,
    turn_at,
)
from tests.oracles import anchors as oracle
from tests.worlds import free_pose, office, scan_at

OFFICE = office(5)
PANEL = polyline((2, -1), (2, 1))
BACK = polyline((5, -9), (5, 9))
ORIGIN = np.zeros(3)


def ahead(world, beams=91):
    """A quarter turn towards x, in which the wall at the back goes on beyond either side."""
    return scan_at(world, ORIGIN, beams, fov=np.pi / 2)


def expected(scan, config):
    beams = oracle.Beams(
        scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max
    )
    part, jump = config.segment, config.jump_edge
    large = [
        members
        for members in oracle.parts(beams, float(part.gap), float(part.incidence))
        if oracle.is_large(beams, members, float(part.min_extent), float(part.min_beams))
    ]
    return oracle.jump_edges(
        beams, large, float(jump.jump), float(jump.relative), float(jump.weight)
    )


@pytest.mark.parametrize("config", [ExtractionConfig(), None], ids=["default", "other"])
@pytest.mark.parametrize("seed", range(4))
def test_jump_edges_equal_the_oracle(extraction, seed, config):
    config = config or ExtractionConfig(
        jump_edge=JumpEdgeConfig(jump=0.5, relative=0.02, weight=0.9)
    )
    rng = np.random.default_rng(seed)
    pose = free_pose(OFFICE, rng)
    scans = (
        scan_at(OFFICE, pose, noise=0.01, rng=rng, range_max=6.0),
        turn_at(OFFICE, pose, start=rng.uniform(-3, 3), noise=0.01, range_max=6.0),
    )
    for scan in scans:
        found = extraction(scan, config).jump_edges
        wanted = expected(scan, config)
        assert_same_points(points_of(found), wanted[:, :2], 1e-4)
        saliences = np.sort(found.salience[found.valid])
        np.testing.assert_allclose(saliences, np.sort(wanted[:, 2]), atol=1e-5)


def test_both_ends_of_a_panel_before_a_wall_are_jump_edges(extraction):
    found = extraction(ahead(np.concatenate([PANEL, BACK]))).jump_edges
    assert_same_points(points_of(found), [(2, -1), (2, 1)], np.hypot(2, 1) * np.pi / 180)


def test_the_far_end_of_a_discontinuity_is_none(extraction):
    anchors = extraction(ahead(np.concatenate([PANEL, BACK]))).anchors
    far = points_of(anchors)[:, 0] > 3
    assert not far.any()


def test_a_panel_before_nothing_at_all_has_two_jump_edges(extraction):
    found = extraction(ahead(PANEL)).jump_edges
    assert_same_points(points_of(found), [(2, -1), (2, 1)], np.hypot(2, 1) * np.pi / 180)


def test_a_wall_cut_off_by_the_field_of_view_has_none(extraction):
    found = extraction(ahead(BACK)).jump_edges
    assert not found.valid.any()


def test_a_wall_cut_off_by_a_nearer_object_has_none(extraction):
    world = np.concatenate([BACK, box(2, 0, 0.1)])
    stages = extraction(ahead(world, beams=361))
    assert not stages.jump_edges.valid.any()
    assert not stages.anchors.valid.any()


def test_a_wall_that_leaves_the_range_limit_has_none(extraction):
    """No return says that the beam is free up to the limit, and there the wall may go on."""
    wall = polyline((1, -40), (1, 40))
    for beams in (181, 361):
        scan = scan_at(wall, ORIGIN, beams, range_max=4.0)
        assert np.isinf(scan.ranges).any()
        assert not extraction(scan).jump_edges.valid.any()


@pytest.mark.parametrize("beams", [181, 361])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_an_endless_corridor_has_none(extraction, beams, noise):
    """Far ahead the hits on its walls lie metres apart, without any discontinuity."""
    walls = np.concatenate([polyline((-90, y), (90, y)) for y in (-1, 1)])
    pose, rng = np.array([0.0, 0.1, 0.1]), np.random.default_rng(0)
    stages = extraction(scan_at(walls, pose, beams, noise=noise, rng=rng, range_max=80.0))
    assert not stages.jump_edges.valid.any()


@pytest.mark.parametrize("value", [np.nan, -np.inf, 0.0, -1.0, 31.0])
@pytest.mark.parametrize("side", [-1, 1])
def test_an_end_next_to_an_invalid_beam_is_none(extraction, value, side):
    scan = ahead(np.concatenate([PANEL, BACK]))
    panel = np.flatnonzero(scan.ranges < 3)
    ranges = scan.ranges.copy()
    ranges[panel[0] - 1 if side < 0 else panel[-1] + 1] = value
    found = points_of(extraction(rebuilt(scan, ranges)).jump_edges)
    assert_same_points(found, [(2, -side)], 0.05)


def test_a_step_below_the_threshold_is_none_and_above_it_is_one(extraction):
    for depth, count in ((0.2, 0), (0.45, 1)):  # 0.2 m and 5 % of 2 m are asked for
        world = polyline((2, -3), (2, 0), (2 + depth, 0), (2 + depth, 3))
        found = extraction(ahead(world, beams=361)).jump_edges
        assert found.valid.sum() == count


@pytest.mark.parametrize("seed", range(5))
def test_a_jump_edge_lies_within_half_a_spacing_of_the_true_end(extraction, seed):
    rng = np.random.default_rng(seed)
    distance, y = rng.uniform(1, 4), rng.uniform(-0.5, 0.5)
    world = np.concatenate([polyline((distance, y - 1), (distance, y + 1)), BACK])
    found = points_of(extraction(turn_at(world, ORIGIN)).jump_edges, Kind.JUMP_EDGE)
    for end in ((distance, y - 1), (distance, y + 1)):
        reach = np.hypot(*end)
        step = reach * SPACING * reach / distance  # a beam's spacing along the panel
        assert distance_to(found, end) <= 0.5 * step + 2e-3


def test_a_jump_at_the_seam_of_a_full_turn_is_found(extraction):
    world = np.concatenate([PANEL, BACK])
    whole = extraction(turn_at(world, ORIGIN)).jump_edges
    bearing = np.arctan2(1, 2)
    for shift in (-1.5, -0.5, 0.5, 1.5):
        # The seam falls between the beams beside the panel's end.
        turns = np.ceil((bearing + np.pi) / SPACING) + shift
        start = -np.pi + np.floor(turns) * SPACING
        found = extraction(turn_at(world, ORIGIN, FULL, start)).jump_edges
        assert_same_points(points_of(found), points_of(whole), 1e-4)
