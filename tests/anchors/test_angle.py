import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.anchors.angle import intersection
from tests.anchors.shapes import (
    SPACING,
    box,
    distance_to,
    points_of,
    polyline,
    room,
    seen_from,
    turn_at,
)
from tests.oracles import anchors as oracle
from tests.worlds import scan_at


@pytest.mark.parametrize("seed", range(8))
def test_lines_meet_where_the_oracle_says(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-5, 5, (2, 2))
    direction_a = rng.uniform(-np.pi, np.pi)
    direction_b = direction_a + rng.choice([-1, 1]) * rng.uniform(0.3, 2.8)
    xy, sine = intersection(
        *(jnp.asarray(v, jnp.float32) for v in (a, direction_a, b, direction_b))
    )
    wanted = oracle.intersection(a, direction_a, b, direction_b)
    np.testing.assert_allclose(xy, wanted, atol=2e-4)
    assert float(sine) == pytest.approx(np.sin(direction_b - direction_a), abs=1e-5)


def test_parallel_lines_meet_at_the_first_point_and_stay_finite():
    a, b = jnp.array([1.0, 2.0]), jnp.array([3.0, -1.0])
    xy, sine = intersection(a, jnp.float32(0.7), b, jnp.float32(0.7))
    np.testing.assert_array_equal(xy, a)
    assert float(sine) == 0


def strongest(candidates, near, reach=0.3):
    """The most salient candidate within reach of a point."""
    close = candidates.valid & (np.linalg.norm(candidates.xy - near, axis=-1) < reach)
    assert close.any(), "no candidate"
    return candidates.xy[np.argmax(np.where(close, candidates.salience, -1))]


@pytest.mark.parametrize("opening", np.radians([60, 90, 120, 140]))
@pytest.mark.parametrize("sense", ["convex", "concave"])
@pytest.mark.parametrize("seed", range(2))
def test_a_noise_free_corner_is_found_to_a_tenth_of_a_beams_spacing(
    extraction, opening, sense, seed
):
    """Two faces of 1.5 m, the corner 2 to 3 m away and towards the scanner or off it."""
    rng = np.random.default_rng(seed)
    distance, tilt = rng.uniform(2, 3), rng.uniform(-0.1, 0.1)
    middle = (0 if sense == "convex" else np.pi) + tilt
    corner = np.array([distance, 0.0])
    ends = [
        corner
        + 1.5 * np.array([np.cos(middle + s * opening / 2), np.sin(middle + s * opening / 2)])
        for s in (-1, 1)
    ]
    world, pose = polyline(ends[0], corner, ends[1]), (0.0, 0.0, rng.uniform(-3, 3))
    found = extraction(turn_at(world, pose)).angles
    place = seen_from(pose, corner)
    assert np.linalg.norm(strongest(found, place) - place) < 0.1 * distance * SPACING


@pytest.mark.parametrize("seed", range(3))
def test_the_corners_of_a_room_are_found_to_a_tenth_of_a_beams_spacing(extraction, seed):
    rng = np.random.default_rng(seed)
    pose = np.array([*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)])
    found = extraction(turn_at(room(6, 5), pose)).angles
    for corner in seen_from(pose, room(6, 5)[:, 0]):
        reach = np.linalg.norm(corner)
        assert np.linalg.norm(strongest(found, corner) - corner) < 0.1 * reach * SPACING


def test_a_straight_wall_has_no_angle(extraction):
    for noise in (0.0, 0.01):
        scan = turn_at(polyline((2, -3), (2, 3)), np.zeros(3), noise=noise)
        assert not extraction(scan).angles.valid.any()


def test_a_gently_curved_wall_has_no_angle(extraction):
    around = np.linspace(np.pi / 2, 3 * np.pi / 2, 200)
    wall = polyline(*np.stack([7 + 5 * np.cos(around), 5 * np.sin(around)], axis=-1))
    assert not extraction(turn_at(wall, np.zeros(3))).angles.valid.any()


def test_a_small_box_has_no_angle_and_a_large_one_has(extraction):
    small, large = (extraction(turn_at(box(2, 2, size), np.zeros(3))) for size in (0.12, 1.0))
    assert not small.angles.valid.any()
    assert distance_to(points_of(large.angles), (1.5, 1.5)) < 2.2 * SPACING


def test_the_seam_of_a_closed_room_hides_no_corner_even_one_that_is_nearest(extraction):
    """An L-shaped room seen from before its inner corner, the nearest point of all."""
    walls = polyline((0, 0), (3, 0), (3, -3), (-3, -3), (-3, 3), (0, 3), closed=True)
    pose = (-0.7, -0.7, 0.4)
    found = extraction(turn_at(walls, pose)).angles
    corner = seen_from(pose, (0, 0))
    assert distance_to(points_of(found), corner) < np.hypot(0.7, 0.7) * SPACING


def test_a_corner_cut_off_by_the_field_of_view_is_none(extraction):
    # The scanner sees one wall of the room and not the other.
    found = extraction(scan_at(room(6, 6), np.zeros(3), fov=np.pi / 2 - 0.1)).angles
    assert not found.valid.any()
