import jax
import numpy as np
import pytest

from aprjax.sim.ray_casting import cast
from aprjax.sim.world import World
from tests.oracles import ray_casting as oracle

SEGMENTS, CIRCLES, RAYS, POSES = 24, 12, 64, 16
BEARINGS = np.linspace(-np.pi, np.pi, RAYS, dtype=np.float32)
cast_one = jax.jit(cast)
cast_all = jax.jit(jax.vmap(cast, (None, 0, None)))


def random_world(seed):
    """Walls, legs and columns in 20 m x 20 m, some of them sharing ends."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-10, 10, (SEGMENTS, 1, 2))
    segments = centre + rng.normal(0, 1, (SEGMENTS, 2, 2)) * rng.uniform(0.1, 3, (SEGMENTS, 1, 1))
    segments[1::2, 0] = segments[::2, 1]
    radius = np.exp(rng.uniform(np.log(0.02), np.log(3), CIRCLES))
    return World.make(segments, np.column_stack([rng.uniform(-10, 10, (CIRCLES, 2)), radius]))


def random_poses(seed, count=POSES):
    rng = np.random.default_rng(seed)
    return rng.uniform([-9, -9, -np.pi], [9, 9, np.pi], (count, 3)).astype(np.float32)


def star(points, seed=0, centre=(0.0, 0.0)):
    """A closed outline that is seen from its centre all around, as segments `(points, 2, 2)`."""
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * np.arange(points) / points
    radius = rng.uniform(3, 5, points)
    corners = np.asarray(centre) + radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], -1)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_ranges_are_those_of_exact_geometry(seed):
    """Up to the rounding of the rays' directions, which also decides who is hit at an edge."""
    world, poses = random_world(seed), random_poses(seed)
    poses[:4, :2] = world.circles[:4, :2] + 0.3 * world.circles[:4, 2:]  # within a circle
    got = np.asarray(cast_all(world, poses, BEARINGS))
    sharp = 0
    for pose, row in zip(poses, got, strict=True):
        exact = np.array(
            [
                oracle.ranges(world.segments, world.circles, pose, BEARINGS.astype(float) + turn)
                for turn in (-2e-6, 0, 2e-6)
            ]
        )
        low, high = exact.min(axis=0), exact.max(axis=0)
        rounding = 1e-5 * (1 + np.minimum(exact[1], 30))
        assert np.all((row >= low - rounding) & (row <= high + rounding))
        sharp += np.sum(high <= low + 1e-3)
    assert sharp > 0.98 * got.size
    assert 0.5 < np.mean(np.isfinite(got)) < 1


def test_a_room_and_a_column_have_their_textbook_distances():
    corners = np.array([[-2, -3], [4, -3], [4, 5], [-2, 5]], float)
    room = World.make(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1), [[3, 3, 0.5]])
    bearings = np.radians([0, 90, 180, -90, 45, -135]).astype(np.float32)
    got = cast_one(room, np.zeros(3, np.float32), bearings)
    expected = [4, 5, 2, 3, 3 * np.sqrt(2) - 0.5, 2 * np.sqrt(2)]
    np.testing.assert_allclose(got, expected, rtol=1e-6)


@pytest.mark.parametrize(("x", "expected"), [(-5, 3), (0, 2), (1.5, 0.5), (5, np.inf)])
def test_a_circle_shows_its_near_side_outside_and_its_far_side_inside(x, expected):
    world = World.make(circles=[[0, 0, 2]])
    got = cast_one(world, np.float32([x, 0, 0]), np.zeros(1, np.float32))
    np.testing.assert_allclose(got, [expected], rtol=1e-6)


@pytest.mark.parametrize("theta", [0.0, 0.7, np.pi])
def test_a_parallel_ray_passes_a_segment_beside_it_and_meets_one_on_it_at_the_nearer_end(theta):
    ahead = np.array([np.cos(theta), np.sin(theta)])
    aside = np.array([-ahead[1], ahead[0]])
    pose, straight_on = np.float32([0, 0, theta]), np.zeros(1, np.float32)
    for ends in ([2 * ahead, 5 * ahead], [5 * ahead, 2 * ahead]):
        beside = World.make([ends + 0.01 * aside])
        assert cast_one(beside, pose, straight_on) == np.inf
        np.testing.assert_allclose(cast_one(World.make([ends]), pose, straight_on), 2, rtol=1e-6)
        behind = World.make([-np.asarray(ends)])
        assert cast_one(behind, pose, straight_on) == np.inf


def test_a_segment_ends_where_it_ends():
    """To a few millionths of a radian."""
    world = World.make([[[2, -1], [2, 2]]])
    right, left = np.arctan2([-1, 2], 2)
    inside = cast_one(world, np.zeros(3, np.float32), np.float32([right + 5e-6, left - 5e-6]))
    np.testing.assert_allclose(inside, [np.sqrt(5), np.sqrt(8)], rtol=1e-4)
    outside = cast_one(world, np.zeros(3, np.float32), np.float32([right - 5e-6, left + 5e-6]))
    assert np.all(np.isposinf(outside))


def test_no_ray_slips_between_segments_that_share_an_end():
    """Rays aimed exactly at the corners of closed outlines, from many places inside."""
    for seed in range(6):
        segments = star(RAYS, seed).astype(np.float32)
        world = World.make(segments)
        for position in random_poses(seed, 20)[:, :2] / 8:
            to_corner = segments[:, 0].astype(float) - position
            bearings = np.arctan2(to_corner[:, 1], to_corner[:, 0]).astype(np.float32)
            got = np.asarray(cast_one(world, np.append(position, np.float32(0)), bearings))
            assert np.all(got <= np.linalg.norm(to_corner, axis=1) * (1 + 1e-5))


def test_no_ray_slips_through_the_corners_of_a_grid():
    """Here the rays meet the ends without any rounding, where half-open tests leak."""
    ticks = np.arange(-3, 3)
    across = [[(x, y), (x + 1, y)] for x in ticks for y in (-3, 3)]
    along = [[(x, y), (x, y + 1)] for y in ticks for x in (-3, 3)]
    world = World.make(np.array(across + along)[:, ::-1])
    for theta in np.radians([0, 90, 180, -90]).astype(np.float32):
        for x in ticks[1:]:
            pose = np.array([x, 0, theta], np.float32)
            got = np.asarray(cast_one(world, pose, np.radians([-45, 0, 45], dtype=np.float32)))
            assert np.all(got < 3 * np.sqrt(2) + 3)


def test_a_world_without_surfaces_returns_nothing():
    assert np.all(np.isposinf(cast_one(World.make(), np.zeros(3, np.float32), BEARINGS)))


def test_padding_is_never_hit_and_changes_nothing():
    world, poses = random_world(5), random_poses(5)
    poses[0] = 0  # where the padding lies
    poses[1] = [-1, 0, 0]  # looks at it
    got = cast_all(world.pad(SEGMENTS + 9, CIRCLES + 3), poses, BEARINGS)
    np.testing.assert_array_equal(got, cast_all(world, poses, BEARINGS))
    points = World.make([[[2, 0], [2, 0]]] * 3, [[2, 0, 0]])
    straight_on = np.zeros(1, np.float32)
    assert cast_one(points, np.zeros(3, np.float32), straight_on) == np.inf


def test_the_order_of_surfaces_and_of_ends_changes_nothing():
    world, poses = random_world(6), random_poses(6)
    rng = np.random.default_rng(0)
    shuffled = World.make(rng.permutation(world.segments), rng.permutation(world.circles))
    got = np.asarray(cast_all(world, poses, BEARINGS))
    np.testing.assert_array_equal(cast_all(shuffled, poses, BEARINGS), got)
    flipped = World.make(world.segments[:, ::-1], world.circles)
    np.testing.assert_allclose(cast_all(flipped, poses, BEARINGS), got, rtol=1e-5, atol=1e-5)


def test_moving_world_and_pose_together_changes_nothing():
    outline = star(SEGMENTS, seed=3)
    rng = np.random.default_rng(3)
    angle = rng.uniform(-np.pi, np.pi, CIRCLES)
    circles = np.column_stack([6 * np.cos(angle), 6 * np.sin(angle), np.full(CIRCLES, 0.5)])
    poses = random_poses(3) * np.float32([0.1, 0.1, 1])
    got = cast_all(World.make(outline, circles), poses, BEARINGS)
    for x, y, theta in [(3, -8, 0.6), (-20, 5, -2.8), (0, 0, np.pi)]:
        turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
        moved = World.make(
            outline @ turn.T + [x, y],
            np.column_stack([circles[:, :2] @ turn.T + [x, y], circles[:, 2]]),
        )
        moved_poses = np.column_stack([poses[:, :2] @ turn.T + [x, y], poses[:, 2] + theta])
        again = cast_all(moved, moved_poses.astype(np.float32), BEARINGS)
        np.testing.assert_allclose(again, got, rtol=1e-4, atol=1e-4)


def test_a_batch_of_poses_equals_single_ones():
    world, poses = random_world(7), random_poses(7)
    batch = cast_all(world, poses, BEARINGS)
    single = np.stack([cast_one(world, pose, BEARINGS) for pose in poses])
    np.testing.assert_allclose(batch, single, rtol=1e-5, atol=1e-5)
