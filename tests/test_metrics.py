from typing import Any

import numpy as np
import pytest

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import Anchors
from aprjax.metrics import (
    Answers,
    is_right,
    pooled,
    reappearing,
    reliability,
    repeatability,
    score_matches,
    world_poses,
)
from aprjax.result import MatchResult
from aprjax.scan import Scan

STILL = np.zeros(3)


def anchors(*points, kinds=None, capacity=6) -> Anchors:
    count = len(points)
    arrays: dict[str, Any] = {
        "xy": np.zeros((capacity, 2), np.float32),
        "kind": np.zeros(capacity, np.int32),
        "salience": np.zeros(capacity, np.float32),
        "valid": np.arange(capacity) < count,
        "overflow": np.int32(0),
    }
    arrays["xy"][:count] = np.reshape(points, (count, 2))
    arrays["kind"][:count] = Kind.ANGLE if kinds is None else kinds
    return Anchors(**arrays)


def seen_from(T_a_b, xy):
    cos, sin = np.cos(T_a_b[2]), np.sin(T_a_b[2])
    return (np.asarray(xy) - T_a_b[:2]) @ np.array([[cos, -sin], [sin, cos]])


def wall(distance, beams=181, first=-90.0):
    return Scan.make(
        np.full(beams, distance),
        angle_min=np.radians(first),
        angle_increment=np.radians(1),
        range_max=20.0,
    )


def test_the_same_anchors_from_another_pose_all_reappear():
    points = [(1, 2), (3, -1), (4, 0.5)]
    T_a_b = np.array([0.7, -0.4, 2.0])
    b = anchors(*seen_from(T_a_b, points))
    assert repeatability(anchors(*points), b, T_a_b) == 1.0
    assert repeatability(anchors(*points), b, STILL) == 0.0


def test_the_share_is_of_the_anchors_of_a_within_the_radius():
    a = anchors((1, 0), (2, 0), (3, 0), (4, 0))
    b = anchors((1.05, 0), (2, 0.2), (3, 0))
    assert repeatability(a, b, STILL) == 0.5
    assert repeatability(a, b, STILL, radius=0.25) == 0.75
    assert repeatability(b, a, STILL) == pytest.approx(2 / 3)


def test_the_kind_does_not_matter_and_padding_is_no_anchor():
    a = anchors((1, 0), (0.01, 0), kinds=[Kind.ANGLE, Kind.JUMP_EDGE])
    b = anchors((1, 0), kinds=[Kind.VIRTUAL_EDGE])
    assert repeatability(a, b, STILL) == 0.5


def test_none_to_count_is_not_a_number():
    assert np.isnan(repeatability(anchors(), anchors((1, 0)), STILL))
    assert repeatability(anchors((1, 0)), anchors(), STILL) == 0.0


def test_what_b_cannot_see_does_not_count():
    points = [(3, 0), (6, 0), (-3, 0), (0, 5), (30, 0), (5.1, 0)]
    counted, found = reappearing(anchors(*points), anchors((3, 0)), STILL, 0.1, wall(5.0))
    assert counted.tolist() == [True, False, False, True, False, True]
    assert found.tolist() == [True, False, False, False, False, False]


def test_virtual_edges_always_count():
    a = anchors((6, 0), (-3, 0), kinds=[Kind.VIRTUAL_EDGE] * 2)
    assert reappearing(a, anchors(), STILL, 0.1, wall(5.0))[0].sum() == 2


def test_an_edge_counts_where_any_of_its_beams_passes():
    ranges = np.full(181, 2.0)
    ranges[91:] = 9.0
    scan = Scan.make(ranges, angle_min=-np.pi / 2, angle_increment=np.pi / 180, range_max=20.0)
    counted, _ = reappearing(anchors((5, 0), (5, -1)), anchors(), STILL, 0.1, scan)
    assert counted[:2].tolist() == [True, False]


@pytest.mark.parametrize("step", [1.0, -1.0])
def test_a_full_turn_has_no_edge_of_view(step):
    scan = Scan.make(
        np.full(360, 5.0), angle_min=0.0, angle_increment=np.radians(step), range_max=20.0
    )
    angle = np.radians([0.0, 90.0, 180.0, 270.0, 359.7])
    points = 4.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    assert reappearing(anchors(*points), anchors(), STILL, 0.1, scan)[0][:5].all()
    beyond = reappearing(anchors(*(2 * points)), anchors(), STILL, 0.1, scan)[0]
    assert not beyond.any()


def test_beams_that_met_nothing_hide_nothing():
    scan = wall(np.inf)
    assert reappearing(anchors((6, 0)), anchors(), STILL, 0.1, scan)[0][0]


def motion(pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0, 0, 1]])


def test_hypotheses_are_placed_by_their_references():
    rng = np.random.default_rng(0)
    ids, T_world_ref = np.array([2, 5, 9]), rng.normal(0, 3, (3, 3))
    reference, T_ref_query = rng.choice(ids, (4, 2)), rng.normal(0, 3, (4, 2, 3))
    fields = dict.fromkeys(MatchResult.__dataclass_fields__)
    result = MatchResult(**fields | {"reference": reference, "T_ref_query": T_ref_query})  # type: ignore
    poses = world_poses(result, ids, T_world_ref)
    for index in np.ndindex(4, 2):
        T_world = T_world_ref[list(ids).index(reference[index])]
        expected = motion(T_world) @ motion(T_ref_query[index])
        np.testing.assert_allclose(motion(poses[index]), expected, atol=1e-12)


def test_right_is_within_half_a_metre_and_ten_degrees():
    truth = np.array([3.0, -2.0, np.pi - 0.01])
    turned = np.radians(9.9) - 0.01
    poses = [
        (3.0, -2.0, np.pi - 0.01),
        (3.49, -2.0, np.pi - 0.01),
        (3.0, -1.49, np.pi - 0.01),
        (3.36, -2.36, np.pi - 0.01),
        (3.0, -2.0, -np.pi + turned),
        (3.0, -2.0, -np.pi + turned + 0.01),
        (3.0, -2.0, np.pi - 0.01 + 6 * np.pi),
    ]
    expected = [True, True, False, False, True, False, True]
    assert is_right(np.array(poses), truth).tolist() == expected


def test_reliability_compares_claims_with_what_is_right_bin_by_bin():
    claimed = np.array([0.0, 0.05, 0.31, 0.39, 0.35, 1.0, 0.95, 1.0])
    right = np.array([0, 0, 1, 0, 0, 1, 1, 0], bool)
    found = reliability(claimed, right)
    np.testing.assert_allclose(found.claimed, [0.025, 0.35, 2.95 / 3])
    np.testing.assert_allclose(found.right, [0, 1 / 3, 2 / 3])
    assert found.count.tolist() == [2, 3, 3]
    wanted = (2 * 0.025 + 3 * abs(0.35 - 1 / 3) + 3 * abs(2.95 / 3 - 2 / 3)) / 8
    assert found.error == pytest.approx(wanted)


def test_no_hypotheses_have_no_calibration_error():
    assert reliability(np.zeros(0), np.zeros(0, bool)).error == 0


def answers(text: str, quality=None) -> Answers:
    """Best hypotheses in descending quality: r right, w wrong, u right but not mapped, - none."""
    marks = np.array(list(text))
    return Answers(
        quality=np.linspace(1, 0.5, len(marks)) if quality is None else np.array(quality),
        right=marks == "r",
        wrong=marks == "w",
        mapped=marks != "u",
    )


@pytest.mark.parametrize(
    ("text", "false", "free", "accepted"),
    [
        ("rrrrwrrrr-", 0.0, 0, 4),
        ("rrrrwrrrr-", 0.0, 1, 8),
        ("rrrrwrrrr-", 0.12, 0, 8),
        ("rrrrwrrrr-", 0.11, 0, 4),
        ("wrrr", 0.2, 0, 0),
        ("wrrrr", 0.2, 0, 4),
        ("wrrwrrrrrr", 0.2, 0, 8),
        ("urur", 0.0, 0, 2),
        ("wwww", 0.5, 1, 0),
        ("----", 0.5, 1, 0),
    ],
)
def test_the_most_generous_threshold_with_few_enough_wrong_is_taken(text, false, free, accepted):
    found = answers(text)
    shuffled = Answers(*(getattr(found, n)[::-1] for n in ("quality", "right", "wrong", "mapped")))
    for each in (found, shuffled):
        assert each.accepted(false, free) == pytest.approx(accepted / found.mapped.sum())


def test_a_threshold_takes_equal_qualities_together():
    assert answers("rrrw", quality=[0.9, 0.8, 0.7, 0.7]).accepted(0.0) == 2 / 4


def test_without_mapped_queries_there_is_no_share():
    assert np.isnan(answers("uu").accepted(0.01))


def test_one_threshold_holds_for_all_logs_that_are_pooled():
    easy, hard = answers("rrrr", [0.9, 0.8, 0.3, 0.2]), answers("rwrr", [0.95, 0.4, 0.35, 0.1])
    assert easy.accepted(0.0) == 1.0
    assert hard.accepted(0.0) == 0.25
    assert pooled([easy, hard]).accepted(0.0) == 3 / 8
    assert pooled([easy, hard]).accepted(0.2) == 7 / 8


def test_scores_are_shares_of_the_mapped_queries():
    """Right, right at rank 1, wrong, right but not mapped, none."""
    truth = np.zeros((5, 3))
    poses = np.full((5, 2, 3), 5.0)
    poses[[0, 1, 3], [0, 1, 0]] = 0.01
    fields = dict.fromkeys(MatchResult.__dataclass_fields__)
    fields |= {
        "reference": np.zeros((5, 2), int),
        "T_ref_query": poses,
        "quality": np.array([[0.9, 0.1], [0.5, 0.4], [0.3, 0.1], [0.8, 0.0], [0, 0]]),
        "valid": np.arange(5)[:, None] < np.array([4, 4]),
    }
    mapped = np.array([True, True, True, False, True])
    found = score_matches(MatchResult(**fields), np.zeros(1, int), truth[:1], truth, mapped)  # type: ignore
    assert (found.top1, found.oracle, found.hits) == (0.25, 0.5, 0.25)
    assert found.error_m == pytest.approx(0.01 * np.sqrt(2))
