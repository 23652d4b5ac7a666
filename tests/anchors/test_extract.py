import jax
import numpy as np
import pytest

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import ExtractionConfig, choose_anchors
from aprjax.scan import Scan
from tests.anchors.shapes import (
    FULL,
    SPACING,
    assert_same_anchors,
    assert_same_points,
    box,
    distance_to,
    mirrored,
    points_of,
    rebuilt,
    room,
    turn_at,
    turned,
    upside_down,
)
from tests.worlds import free_pose, office, scan_at

MANY = 5120  # slots for long scans
OFFICE = office(7)
ROOM = np.concatenate([room(7, 5), box(1.5, 2.0, 0.7)])
POSES = [(0.5, 0.3, 0.2), (-1.2, -0.4, 1.9), (2.0, -1.0, -2.4)]


def office_pose(seed):
    return free_pose(OFFICE, np.random.default_rng(seed))


# Laws.


@pytest.mark.parametrize("angle", [np.pi / 2, -np.pi / 2, np.pi])
@pytest.mark.parametrize("pose", POSES)
def test_turning_the_scan_turns_the_anchors(extraction, pose, angle):
    scan = turn_at(ROOM, pose, noise=0.005)
    before = extraction(scan).anchors
    after = extraction(rebuilt(scan, angle_min=scan.angle_min + angle)).anchors
    assert before.valid.sum() >= 6
    assert_same_anchors(before, after, 0.02, lambda points: turned(points, angle))


@pytest.mark.parametrize("angle", [0.01, 0.4, -1.3])
@pytest.mark.parametrize("pose", POSES)
def test_turning_the_scan_by_any_angle_turns_jump_edges_and_angles_exactly(extraction, pose, angle):
    scan = turn_at(ROOM, pose, noise=0.005)
    before = extraction(scan)
    after = extraction(rebuilt(scan, angle_min=scan.angle_min + angle))
    for name in ("jump_edges", "angles"):
        one, other = getattr(before, name), getattr(after, name)
        assert_same_points(turned(points_of(one), angle), points_of(other), 1e-3)
    for corner in turned(points_of(before.anchors, Kind.VIRTUAL_EDGE), angle):
        assert distance_to(points_of(after.anchors), corner) < 0.03


@pytest.mark.parametrize("shift", [1, 37, 200, FULL - 1])
@pytest.mark.parametrize("pose", POSES)
def test_the_place_of_the_seam_changes_no_anchor(extraction, pose, shift):
    for world in (ROOM, room(6, 4)):
        scan = turn_at(world, pose, noise=0.005)
        shifted = rebuilt(
            scan, np.roll(scan.ranges, -shift), scan.angle_min + shift * scan.angle_increment
        )
        assert_same_anchors(extraction(scan).anchors, extraction(shifted).anchors, 1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_a_mirrored_scan_has_mirrored_anchors(extraction, seed):
    scans = (
        turn_at(OFFICE, office_pose(seed), noise=0.005, start=0.3),
        scan_at(OFFICE, office_pose(seed), noise=0.005, rng=np.random.default_rng(seed)),
    )
    for scan in scans:
        before, after = extraction(scan).anchors, extraction(mirrored(scan)).anchors
        assert_same_anchors(before, after, 0.01, lambda points: points * [1, -1])


@pytest.mark.parametrize("seed", range(4))
def test_a_scanner_upside_down_has_the_same_anchors(extraction, seed):
    scans = (
        turn_at(OFFICE, office_pose(seed), noise=0.005, start=0.3),
        scan_at(OFFICE, office_pose(seed), noise=0.005, rng=np.random.default_rng(seed)),
    )
    for scan in scans:
        assert_same_anchors(extraction(scan).anchors, extraction(upside_down(scan)).anchors, 2e-3)


@pytest.mark.parametrize("beams", [FULL, 360, 181])
def test_padding_changes_no_anchor(extraction, beams):
    fov = scan_at(OFFICE, office_pose(1), beams) if beams == 181 else None
    scan = fov or turn_at(OFFICE, office_pose(1), beams)
    short, long = extraction(scan).anchors, extraction(scan, slots=MANY).anchors
    np.testing.assert_array_equal(short.valid, long.valid)
    np.testing.assert_array_equal(short.kind, long.kind)
    np.testing.assert_allclose(short.xy, long.xy, atol=1e-4)
    np.testing.assert_allclose(short.salience, long.salience, atol=1e-4)
    assert short.overflow == long.overflow


@pytest.mark.parametrize("pose", POSES)
def test_anchors_stay_where_they_are_under_noise(extraction, pose):
    clean = extraction(turn_at(ROOM, pose)).anchors
    noisy = extraction(turn_at(ROOM, pose, noise=0.01, seed=3)).anchors
    found = [distance_to(points_of(noisy), point) < 0.1 for point in points_of(clean)]
    assert np.mean(found) >= 0.8


# What carries anchors and what does not.


def test_chair_legs_carry_no_anchors_and_move_none(extraction):
    legs = np.concatenate([box(x, y, 0.04) for x in (0.6, 1.0) for y in (-0.4, 0.4)])
    pose = (-1.0, 0.1, 0.3)
    bare = points_of(extraction(turn_at(room(6, 5), pose)).anchors)
    found = points_of(extraction(turn_at(np.concatenate([room(6, 5), legs]), pose)).anchors)
    assert_same_points(bare, found, 0.02)


def test_an_object_is_removed_by_its_extent(extraction):
    for size, carries in ((0.15, False), (0.9, True)):
        found = points_of(extraction(turn_at(box(2, 0, size), np.zeros(3))).anchors)
        assert (len(found) > 0) == carries


def test_all_three_kinds_are_found_in_an_office(extraction):
    kinds = set()
    for seed in range(4):
        anchors = extraction(turn_at(OFFICE, office_pose(seed), noise=0.01)).anchors
        kinds |= set(anchors.kind[anchors.valid])
    assert kinds == set(Kind)


# Capacity.


@pytest.fixture(scope="module")
def choose():
    return jax.jit(choose_anchors)


def test_more_anchors_than_slots_keep_the_most_salient_and_are_counted(extraction, choose):
    stages = extraction(turn_at(ROOM, POSES[0]))
    everything = stages.anchors
    count = int(everything.valid.sum())
    assert (count > 4, everything.overflow) == (True, 0)
    few = jax.device_get(choose(stages.segments, stages.surface, ExtractionConfig(anchors=4)))
    assert few.xy.shape == (4, 2)
    np.testing.assert_allclose(few.xy, everything.xy[:4], atol=1e-5)
    assert few.overflow >= count - 4


def test_anchors_are_sorted_apart_and_zero_where_not_valid(extraction):
    for seed in range(6):
        anchors = extraction(turn_at(OFFICE, office_pose(seed), noise=0.01)).anchors
        real = anchors.valid
        assert (np.diff(real.astype(int)) <= 0).all()
        assert (np.diff(anchors.salience) <= 0).all()
        xy = anchors.xy[real]
        gaps = np.linalg.norm(xy[:, None] - xy, axis=-1) + 9 * np.eye(len(xy))
        assert gaps.min() >= 0.25 - 1e-5
        for array in (anchors.xy, anchors.kind, anchors.salience):
            assert not array[~real].any()


# Edge cases, and the anchors that each has; None where some may be found.

RNG = np.random.default_rng(0)
DEGREE = np.pi / 180
EDGE_CASES = {
    "no return": (np.full(181, np.inf), DEGREE, 0),
    "all invalid": (np.full(181, np.nan), DEGREE, 0),
    "too close": (np.full(181, -np.inf), DEGREE, 0),
    "zeros": (np.zeros(181), DEGREE, 0),
    "negative": (np.full(181, -2.0), DEGREE, 0),
    "over range": (np.full(181, 30.1), DEGREE, 0),
    "largest floats": (np.full(181, 3.4e38), DEGREE, 0),
    "one beam": ([2.0], DEGREE, 0),
    "one beam, no return": ([np.inf], DEGREE, 0),
    "two beams": ([2.0, 2.1], DEGREE, 0),
    "two beams of a full turn": ([2.0, 2.1], np.pi, 0),
    "three beams of a full turn": ([2.0, 2.1, 2.0], 2 * np.pi / 3, 0),
    "one hit among nothing": (np.where(np.arange(181) == 90, 2.0, np.inf), DEGREE, 0),
    "duplicates": (np.full(181, 2.0), DEGREE, None),  # a half circle
    "a full circle": (np.full(360, 2.0), DEGREE, None),
    "hits at the sensor": (np.full(181, 0.02), DEGREE, 0),
    "every fifth beam": (np.where(np.arange(181) % 5 == 0, 2.0, np.nan), DEGREE, 0),
    "white noise": (RNG.uniform(0, 40, 384), SPACING, None),
    "everything at once": (
        RNG.choice([np.nan, np.inf, -np.inf, 0.0, -1.0, 1.0, 2.0, 2.1, 31.0], 384),
        SPACING,
        None,
    ),
    "clockwise": (np.full(181, 2.0), -DEGREE, None),
}


def assert_finite(stages):
    """Nothing is NaN, and only ranges without return and what is not valid may be infinite."""
    for name, stage in stages._asdict().items():
        for path, leaf in jax.tree_util.tree_leaves_with_path(stage):
            assert not np.isnan(leaf).any(), (name, path)
            if name in ("jump_edges", "angles", "virtual_edges"):
                assert np.isfinite(leaf[stage.valid]).all(), (name, path)
            elif not (name == "segments" and path[-1].name == "range"):
                assert np.isfinite(leaf).all(), (name, path)


@pytest.mark.parametrize("name", EDGE_CASES)
def test_an_edge_case_gives_finite_values_and_no_anchors(extraction, name):
    ranges, step, count = EDGE_CASES[name]
    scan = Scan.make(ranges, angle_min=-np.pi / 2, angle_increment=step, range_max=30.0)
    stages = extraction(scan)
    assert_finite(stages)
    if count is not None:
        assert stages.anchors.valid.sum() == count
        assert stages.anchors.overflow == 0


def test_a_scan_of_a_padded_batch_has_no_beams_and_no_anchors(extraction):
    batch = Scan.stack([turn_at(ROOM, POSES[0])], slots=FULL).pad_batch(2)
    stages = extraction(jax.tree.map(lambda array: array[1], batch))
    assert_finite(stages)
    assert not stages.segments.hit.any()
    assert not stages.anchors.valid.any()


@pytest.mark.parametrize("seed", range(3))
def test_values_are_finite_on_office_scans(extraction, seed):
    assert_finite(extraction(turn_at(OFFICE, office_pose(seed), noise=0.01)))


def test_a_scan_of_5000_beams_has_the_corners_of_a_coarse_one(extraction):
    fine = extraction(turn_at(ROOM, POSES[0], beams=5000), slots=MANY)
    assert_finite(fine)
    coarse = extraction(turn_at(ROOM, POSES[0]))
    # Angles may differ: a coarse scan links a box to the wall 16 cm behind its edge.
    corners = coarse.anchors.xy[coarse.anchors.valid & (coarse.anchors.kind == Kind.VIRTUAL_EDGE)]
    assert len(corners) == 4
    for point in corners:
        assert distance_to(points_of(fine.anchors), point) < 0.06


@pytest.mark.parametrize("start", [-np.pi, -0.7, 0.0, 0.6, 2.0])
def test_the_seam_inside_a_wall_makes_no_anchor(extraction, start):
    anchors = extraction(turn_at(room(6, 4), (0.2, 0.1, 0.0), start=start)).anchors
    corners = room(6, 4)[:, 0] - [0.2, 0.1]
    assert_same_points(points_of(anchors), corners, 0.02)


# Compilation.


def test_no_threshold_compiles_anew(extraction):
    scan, config = turn_at(ROOM, POSES[0]), ExtractionConfig()
    extraction(scan)
    traces = extraction.traces
    leaves, structure = jax.tree.flatten(config)
    assert len(leaves) > 20
    for k, leaf in enumerate(leaves):
        changed = [*leaves[:k], leaf * np.float32(0.9), *leaves[k + 1 :]]
        extraction(scan, jax.tree.unflatten(structure, changed))
    assert extraction.traces == traces
