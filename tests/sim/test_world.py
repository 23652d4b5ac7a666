import numpy as np
import pytest

from aprjax.sim.world import World


def test_a_world_holds_float32_on_the_host():
    world = World.make([[[0, 0], [1, 2]]], [[1, 2, 0.5]])
    assert isinstance(world.segments, np.ndarray) and world.segments.dtype == np.float32
    assert world.segments.shape == (1, 2, 2) and world.circles.shape == (1, 3)
    empty = World.make()
    assert empty.segments.shape == (0, 2, 2) and empty.circles.shape == (0, 3)


@pytest.mark.parametrize(
    ("segments", "circles", "message"),
    [
        ([[0, 0, 1, 1]], [], r"segments: shape \(1, 4\)"),
        ([], [[0, 1]], r"circles: shape \(1, 2\)"),
        (1.0, [], r"segments: shape \(\)"),
        ([[[0, 0], [1, np.nan]]], [], r"segments\[0, 1, 1\]: nan"),
        ([], [[0, 0, 1], [np.inf, 0, 1]], r"circles\[1, 0\]: inf"),
        ([], [[0, 0, 1], [0, 0, -0.25]], r"circles\[1\]: radius -0.25 m"),
    ],
)
def test_a_bad_world_is_refused_by_field_index_and_value(segments, circles, message):
    with pytest.raises(ValueError, match=message):
        World.make(segments, circles)


def test_padding_keeps_what_there_is_and_refuses_to_drop_any():
    world = World.make([[[0, 0], [1, 2]]], [[1, 2, 0.5], [3, 4, 0.5]])
    padded = world.pad(4, 3)
    np.testing.assert_array_equal(padded.segments[:1], world.segments)
    np.testing.assert_array_equal(padded.circles[:2], world.circles)
    assert not padded.segments[1:].any() and not padded.circles[2:].any()
    with pytest.raises(ValueError, match="circles: 1 is fewer than the 2 there are"):
        world.pad(4, 1)
    with pytest.raises(ValueError, match="segments: 0 is fewer than the 1 there are"):
        world.pad(0, 2)


def test_a_batch_of_worlds_pads_its_surfaces():
    batch = World(np.zeros((5, 3, 2, 2), np.float32), np.zeros((5, 2, 3), np.float32)).pad(8, 8)
    assert batch.segments.shape == (5, 8, 2, 2) and batch.circles.shape == (5, 8, 3)
