import dataclasses

import networkx as nx
import numpy as np
import pytest

from aprjax.sim.camera import Camera, take_images
from aprjax.sim.drive import drive
from aprjax.sim.floor_plan import FloorPlan, office
from aprjax.sim.furniture import Piece, block
from aprjax.sim.textures import CEILING, FLOOR, ROOM_HEIGHT, Textures

EVEN = {"noise": 0.0, "dimmest": 1.0, "tint": 0.0}


def hall(*pieces):
    """A bare hall of 8 m by 6 m around the origin, its walls red, green, blue and yellow."""
    corners = np.array([(4.0, -3.0), (4.0, 3.0), (-4.0, 3.0), (-4.0, -3.0)])
    walls = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    plan = FloorPlan(walls, (), tuple(pieces), nx.Graph())
    textures = Textures.draw(0, plan)
    paint = np.array([(0.8, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.8), (0.8, 0.8, 0.1)])
    bare = np.full_like(textures.poster, np.nan)
    return plan, dataclasses.replace(textures, paint=paint, poster=bare)


def look(plan, textures, pose, **camera):
    return take_images(0, Camera(**{**EVEN, **camera}), plan, textures, np.array([pose]))[0]


def as_bytes(colour):
    return np.round(255 * np.asarray(colour)).astype(np.uint8)


def test_the_middle_looks_ahead_and_the_first_column_to_the_left():
    plan, textures = hall()
    image = look(plan, textures, (0.0, 0.0, 0.0), field_of_view=np.pi, rows=16, columns=65)
    row = image[7]
    np.testing.assert_array_equal(row[32], as_bytes(textures.paint[0]))
    np.testing.assert_array_equal(row[0], as_bytes(textures.paint[1]))
    np.testing.assert_array_equal(row[-1], as_bytes(textures.paint[3]))


def test_a_turn_of_the_robot_shifts_the_columns_of_a_panorama():
    plan, textures = hall()
    plain = look(plan, textures, (0.5, 0.3, 0.1), columns=64)
    turned = look(plan, textures, (0.5, 0.3, 0.1 + 2 * np.pi * 5 / 64), columns=64)
    np.testing.assert_array_equal(turned, np.roll(plain, 5, axis=1))


def test_floor_and_ceiling_begin_where_the_wall_ends():
    plan, textures = hall()
    camera = Camera(**EVEN, rows=400, columns=1, field_of_view=0.01, height=1.0)
    image = take_images(0, camera, plan, textures, np.zeros((1, 3)))[0, :, 0]
    wall = camera.height + camera.slopes * 4.0
    np.testing.assert_array_equal(
        image[wall > ROOM_HEIGHT], np.tile(as_bytes(CEILING), (np.sum(wall > ROOM_HEIGHT), 1))
    )
    np.testing.assert_array_equal(image[wall < 0], np.tile(as_bytes(FLOOR), (np.sum(wall < 0), 1)))
    between = (wall > 0.2) & (wall < ROOM_HEIGHT)
    assert between.sum() > 50
    assert np.all(image[between] == as_bytes(textures.paint[0]))


def test_furniture_hides_the_wall_up_to_its_height():
    plan, textures = hall(Piece(block(0.6, 0.6), np.array([2.3, 0.0, 0.0])))
    textures = dataclasses.replace(textures, furniture_height=np.array([1.2]))
    camera = Camera(**EVEN, rows=400, columns=1, field_of_view=0.01)
    image = take_images(0, camera, plan, textures, np.zeros((1, 3)))[0, :, 0]
    at_piece = camera.height + camera.slopes * 2.0
    piece = (at_piece < 1.2) & (at_piece > 0)
    assert np.all(image[piece] == as_bytes(textures.furniture[0]))
    assert not np.any(np.all(image[~piece] == as_bytes(textures.furniture[0]), axis=-1))


def test_a_wall_hides_the_furniture_behind_it():
    plan, textures = hall(Piece(block(0.6, 0.6), np.array([6.0, 0.0, 0.0])))
    bare, plain = hall()
    pose = (0.0, 0.0, 0.3)
    np.testing.assert_array_equal(look(plan, textures, pose), look(bare, plain, pose))


def test_posters_hang_at_their_place_on_the_wall_from_wherever_they_are_seen():
    plan, textures = hall()
    poster = textures.poster.copy()
    poster[0, 2] = (1.0, 0.0, 1.0)  # on the wall ahead, which runs from y = -3 to 3
    textures = dataclasses.replace(textures, poster=poster)
    (left, right), (low, high) = textures.poster_span[0, 2]
    middle = -3.0 + 2 * 1.4 + min((left + right) / 2, 1.3)
    for x, y in ((0.0, 0.0), (2.0, 1.5), (-2.0, -2.0)):
        toward = np.arctan2(middle - y, 4.0 - x)
        camera = Camera(
            **EVEN, rows=1, columns=1, field_of_view=1e-3, height=float((low + high) / 2)
        )
        image = take_images(0, camera, plan, textures, np.array([(x, y, toward)]))[0, 0, 0]
        np.testing.assert_array_equal(image, as_bytes((1.0, 0.0, 1.0)))


def test_surfaces_keep_their_looks_when_the_floor_is_rearranged():
    plan = office(2)
    textures, again = Textures.draw(7, plan), Textures.draw(7, plan.rearranged(1, 1.0))
    for name in ("paint", "poster", "poster_span", "furniture", "furniture_height"):
        np.testing.assert_array_equal(getattr(textures, name), getattr(again, name))


def test_the_same_seed_gives_the_same_images_and_another_other_light():
    plan = office(2)
    textures = Textures.draw(7, plan)
    poses, _ = drive(0, plan, 20, 2.0)
    first, again, other = (take_images(s, Camera(), plan, textures, poses) for s in (1, 1, 2))
    assert first.dtype == np.uint8
    assert first.shape == (20, 16, 64, 3)
    np.testing.assert_array_equal(first, again)
    ratio = first.mean(axis=(1, 2)) / other.mean(axis=(1, 2))
    assert np.ptp(ratio) > 0.1  # it drifts, and not in all channels alike


def test_noise_has_the_size_that_was_asked_for():
    plan, textures = hall()
    clean = look(plan, textures, (0.0, 0.0, 0.2)).astype(float)
    noisy = look(plan, textures, (0.0, 0.0, 0.2), noise=0.03).astype(float)
    inside = (clean > 60) & (clean < 220)
    assert np.std((noisy - clean)[inside]) == pytest.approx(0.03 * 255, rel=0.1)


@pytest.mark.parametrize(
    ("field", "value"),
    [("rows", 0), ("columns", 0), ("field_of_view", 7.0), ("height", 3.0), ("dimmest", 0.0)],
)
def test_a_camera_without_sense_is_refused(field, value):
    with pytest.raises(ValueError, match=f"{field}: {value}"):
        Camera(**{field: value})


def test_poses_of_another_shape_are_refused():
    plan, textures = hall()
    with pytest.raises(ValueError, match=r"T_world_camera: shape \(3,\)"):
        take_images(0, Camera(), plan, textures, np.zeros(3))
