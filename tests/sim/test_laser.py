import dataclasses

import jax
import numpy as np
import pytest

from aprjax.scan import Scan
from aprjax.sim import laser as module
from aprjax.sim.laser import Laser, take_scan, take_scans
from aprjax.sim.world import World
from tests.oracles import ray_casting as oracle

# Every scanner here has as many beams, so that all share one compilation.
BEAMS = 181
KEY = jax.random.key(0)
NO_ERRORS = ("bias", "noise", "noise_per_metre", "dropout", "mixed")
PERFECT = {**dict.fromkeys(NO_ERRORS, 0.0), "resolution": 0.001}
ORIGIN = np.zeros((1, 3))


def perfect(**changes):
    return Laser.sick(**{**PERFECT, **changes})


def perfect_full_turn(**changes):
    return Laser.full_turn(BEAMS, **{**PERFECT, **changes})


def surrounding(radius):
    """A round wall: from its centre, every beam is as long."""
    return World.make(circles=[[0, 0, radius]])


def taken(laser, world, poses=ORIGIN, moving=None, key=KEY):
    return take_scans(key, laser, world, moving, poses).ranges


def many(laser, radius, count=64):
    return taken(laser, surrounding(radius), np.zeros((count, 3)))


def star_room(seed=0, corners=24):
    """A closed room whose walls are all seen from its middle, without a depth step there."""
    angles = 2 * np.pi * np.arange(corners) / corners
    radius = np.random.default_rng(seed).uniform(3, 5, corners)
    xy = radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return World.make(np.stack([xy, np.roll(xy, -1, axis=0)], axis=1))


def panels(seed=0):
    """A round wall with panels and poles standing before it."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(2, 4, (8, 1)) * np.exp(1j * np.arange(8) * np.pi / 4)[:, None]
    half = 0.4 * np.exp(1j * rng.uniform(0, np.pi, (8, 1)))
    ends = np.concatenate([centre - half, centre + half], axis=1)
    angle = np.pi / 8 + np.arange(8) * np.pi / 4
    poles = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.full(8, 0.03)])
    return World.make(np.stack([ends.real, ends.imag], axis=-1), [[0, 0, 8], *poles])


def poses_around(seed, count=24):
    return np.random.default_rng(seed).uniform([-1, -1, -np.pi], [1, 1, np.pi], (count, 3))


def exact_depths(laser, world, pose):
    """The oracle's ranges `(3, beams)` along each beam's right side, centre and left side."""
    bearings = float(laser.angle_min) + np.arange(laser.beams) * float(laser.angle_increment)
    half = float(laser.divergence) / 2
    sides = [bearings - half, bearings, bearings + half]
    return np.array([oracle.ranges(world.segments, world.circles, pose, side) for side in sides])


def test_without_errors_a_scan_is_exact_geometry_in_steps_of_the_resolution():
    laser, world, poses = perfect(), panels(), poses_around(0, 6).astype(np.float32)
    for pose, ranges in zip(poses, taken(laser, world, poses), strict=True):
        exact = exact_depths(laser, world, pose)[1]
        # A beam that meets the very end of a panel may fall on either side of it.
        assert np.mean(np.abs(ranges - exact) > 0.00051) < 0.02


@pytest.mark.parametrize("radius", [1.0, 20.0])
def test_the_statistical_error_grows_with_range_and_is_independent_for_each_beam(radius):
    laser = perfect(noise=0.005, noise_per_metre=0.001)
    error = many(laser, radius) - radius
    assert np.std(error) == pytest.approx(np.hypot(0.005, 0.001 * radius), rel=0.03)
    assert abs(np.mean(error)) < 0.001
    for one, other in ((error[:, 1:], error[:, :-1]), (error[1:], error[:-1])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.05


def test_the_systematic_error_is_one_bounded_offset_for_each_scan():
    offset = many(perfect(bias=0.015), 3.0) - 3.0
    assert np.all(np.ptp(offset, axis=1) < 1e-6)
    assert np.abs(offset).max() < 0.0156
    assert np.std(offset[:, 0]) == pytest.approx(0.015 / np.sqrt(3), rel=0.2)


def test_the_share_of_dropouts_is_as_set():
    assert np.mean(np.isnan(many(perfect(dropout=0.1), 3.0))) == pytest.approx(0.1, abs=0.01)
    assert np.all(np.isnan(many(perfect(dropout=1.0), 3.0)))
    assert not np.any(np.isnan(many(perfect(dropout=0.0), 3.0)))


def test_dropouts_are_nan_also_where_jax_looks_for_mistakes():
    ranges = taken(Laser.sick(dropout=0.3), star_room())
    with jax.debug_nans(True):
        again = taken(Laser.sick(dropout=0.3), star_room())
    np.testing.assert_array_equal(again, ranges)
    assert 0 < np.isnan(ranges).sum() < ranges.size


def test_mixed_pixels_lie_on_depth_steps_and_between_both_depths():
    world, poses = panels(), poses_around(1).astype(np.float32)
    laser = perfect(divergence=0.01, mixed=1.0)
    mixed, plain = taken(laser, world, poses), taken(perfect(divergence=0.01), world, poses)
    count = 0
    for pose, ranges, clean in zip(poses, mixed, plain, strict=True):
        depths = exact_depths(laser, world, pose)
        near, far = depths.min(axis=0), depths.max(axis=0)
        differs = ranges != clean
        assert np.all((ranges > near - 0.002) & (ranges < far + 0.002))
        assert np.all(far[differs] - near[differs] > 0.1)
        # What is seen at a shallow angle changes its range within a beam without any step.
        assert np.mean(differs[far - near > 1]) > 0.95
        count += differs.sum()
    assert count > 100


def test_mixed_pixels_have_their_share_and_any_depth_between_whatever_drops_out():
    """One beam looks past the end of a panel at the wall behind it, many times."""
    world = World.make([[[2, 0.0005], [2, 1]], [[4, -5], [4, 5]]])
    standing = np.zeros((960, 3))
    beam = taken(perfect(mixed=0.3, dropout=0.3), world, standing)[:, BEAMS // 2]
    beam = beam[~np.isnan(beam)]
    between = beam[(beam > 2.001) & (beam < 3.999)]
    assert np.all((beam >= 2) & (beam <= 4.001))
    assert len(between) / len(beam) == pytest.approx(0.3, abs=0.06)
    quartiles = np.quantile(between, [0.25, 0.5, 0.75])
    np.testing.assert_allclose(quartiles, [2.5, 3.0, 3.5], atol=0.2)


def test_a_wall_seen_at_a_shallow_angle_and_one_before_nothing_mix_no_pixels():
    along = World.make([[[-30, 0.3], [30, 0.3]]])
    pose = np.array([[0, 0, 0.02]])
    np.testing.assert_array_equal(
        taken(perfect(mixed=1.0), along, pose), taken(perfect(), along, pose)
    )
    panel = [[[2, -0.5], [2, 0.5]]]
    poses = poses_around(3) * [1, 1, 0.1]
    for world in (World.make(panel), World.make(panel, [[0, 0, 9]])):
        near = perfect(range_max=6.0)
        np.testing.assert_array_equal(
            taken(perfect(range_max=6.0, mixed=1.0), world, poses), taken(near, world, poses)
        )


def test_a_smaller_step_than_the_least_mixes_nothing():
    """A pole 7 cm before a wall, thinner than the beam."""
    world = World.make([[[2.92, -2], [2.92, 2]]], [[2.87, 0, 0.02]])
    poses = np.column_stack([np.zeros(20), np.linspace(-0.1, 0.1, 20), np.zeros(20)])
    plain = taken(perfect(), world, poses)
    wide = {"mixed": 1.0, "divergence": 0.02}
    np.testing.assert_array_equal(taken(perfect(**wide), world, poses), plain)
    assert np.any(taken(perfect(**wide, mixed_step=0.05), world, poses) != plain)


def test_the_same_key_gives_the_same_bits_and_another_key_others():
    laser, world, poses = Laser.sick(resolution=0.001), star_room(), poses_around(4)
    first, again = taken(laser, world, poses), taken(laser, world, poses)
    assert first.tobytes() == again.tobytes()
    other = taken(laser, world, poses, key=jax.random.key(1))
    hit = np.isfinite(first) & np.isfinite(other)
    assert np.mean(first[hit] != other[hit]) > 0.8
    # Nor do the scans of one key repeat each other's errors.
    standing = taken(Laser.sick(dropout=0.0, resolution=0.001), world, np.zeros((70, 3)))
    assert len(np.unique(standing, axis=0)) == 70


def test_a_scan_depends_neither_on_how_many_there_are_nor_on_the_chunks(monkeypatch):
    laser, world, poses = Laser.sick(resolution=0.001), panels(), poses_around(5, 70)
    whole = taken(laser, world, poses)
    for count in (1, 33):
        np.testing.assert_array_equal(taken(laser, world, poses[:count]), whole[:count])
    others = poses.copy()
    others[1::2] += 0.3
    np.testing.assert_array_equal(taken(laser, world, others)[::2], whole[::2])
    monkeypatch.setattr(module, "_CHUNK", 16)
    rechunked = taken(laser, world, poses)
    # Another program may round otherwise, and so reach the next step of the resolution.
    np.testing.assert_allclose(rechunked, whole, atol=0.0011)


def test_a_batch_equals_single_scans():
    laser, world = Laser.sick(resolution=0.001), panels()
    poses = poses_around(6, 4).astype(np.float32)
    batch = take_scans(KEY, laser, world, None, poses)
    single = jax.jit(take_scan)
    for index, pose in enumerate(poses):
        scan = single(jax.random.fold_in(KEY, index), laser, world, pose)
        np.testing.assert_allclose(batch.ranges[index], scan.ranges, atol=0.0011)
        for name in ("angle_min", "angle_increment", "range_min", "range_max", "beams"):
            assert getattr(batch, name)[index] == getattr(scan, name)


def test_scans_are_stacked_on_the_host_with_a_slot_for_each_beam():
    scans = take_scans(KEY, Laser.sick(), star_room(), None, np.zeros((3, 3)))
    assert all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(scans))
    assert scans.ranges.shape == (3, BEAMS) and scans.ranges.dtype == np.float32
    made = Scan.make(
        scans.ranges[1], angle_min=-np.pi / 2, angle_increment=np.pi / 180, range_max=80.0
    )
    for stacked, single in zip(jax.tree.leaves(scans), jax.tree.leaves(made), strict=True):
        np.testing.assert_array_equal(stacked[1], single)
        assert stacked.dtype == single.dtype


def test_each_scan_sees_its_own_moving_circles():
    legs = np.array([[[2, 0, 0.1], [0, 0, 0]], [[0, 0, 0], [3, 0, 0.1]], [[0, 0, 0], [0, 0, 0]]])
    ranges = taken(perfect(), surrounding(6.0), np.zeros((3, 3)), legs)
    np.testing.assert_allclose(ranges[:, BEAMS // 2], [1.9, 2.9, 6.0], atol=1e-6)
    np.testing.assert_allclose(ranges[:, 0], 6.0, atol=1e-6)


def test_turning_the_robot_by_whole_steps_shifts_the_scan():
    laser = perfect()
    steps = np.array([0, 1, 7, 60, -25])
    poses = np.column_stack([np.tile([0.3, -0.2], (5, 1)), 0.4 + steps * laser.angle_increment])
    still, *turned = taken(laser, star_room(), poses)
    for step, ranges in zip(steps[1:], turned, strict=True):
        kept = slice(step, None) if step > 0 else slice(None, step)
        moved = slice(None, -step) if step > 0 else slice(-step, None)
        np.testing.assert_allclose(ranges[moved], still[kept], atol=0.0011)


def test_turning_a_full_turn_scanner_by_whole_steps_shifts_its_scan_around():
    laser = perfect_full_turn()
    steps = np.array([0, 1, 17, BEAMS // 2, BEAMS - 1, BEAMS, -40])
    poses = np.column_stack([np.tile([0.3, -0.2], (7, 1)), 0.4 + steps * laser.angle_increment])
    still, *turned = taken(laser, star_room(), poses)
    for step, ranges in zip(steps[1:], turned, strict=True):
        np.testing.assert_allclose(ranges, np.roll(still, -step), atol=0.0011)


@pytest.mark.parametrize("beams", [5, BEAMS, 360, 1440])
def test_a_full_turn_scanner_closes_without_a_doubled_beam(beams):
    laser = Laser.full_turn(beams)
    scan = Scan.make(
        np.ones(beams),
        angle_min=float(laser.angle_min),
        angle_increment=float(laser.angle_increment),
        range_max=2.0,
    )
    assert bool(scan.full_turn)
    assert beams * float(laser.angle_increment) == pytest.approx(2 * np.pi, rel=1e-6)


def test_scans_tell_a_full_turn_from_a_half():
    full, half = (
        take_scans(KEY, laser, star_room(), None, np.zeros((2, 3)))
        for laser in (Laser.full_turn(BEAMS), Laser.sick())
    )
    assert np.all(full.full_turn) and not np.any(half.full_turn)


@pytest.mark.parametrize(("resolution_deg", "beams"), [(1.0, 181), (0.5, 361)])
def test_the_sick_looks_over_the_front_half_turn(resolution_deg, beams):
    laser = Laser.sick(resolution_deg)
    assert laser.beams == beams
    last = laser.angle_min + (beams - 1) * laser.angle_increment
    np.testing.assert_allclose([laser.angle_min, last], [-np.pi / 2, np.pi / 2], rtol=1e-6)


def test_ranges_beyond_the_limits_have_the_codes_of_rep_117():
    noisy = {"noise": 0.01, "noise_per_metre": 0.01, "bias": 0.01}
    laser = perfect(range_min=0.1, range_max=5.0)
    assert np.all(np.isneginf(taken(laser, surrounding(0.05))))
    assert np.all(taken(laser, surrounding(5.0)) == np.float32(5.0))
    assert np.all(np.isposinf(taken(laser, surrounding(5.1))))
    for changes in ({}, noisy):
        assert np.all(np.isposinf(taken(perfect(**changes), World.make())))
    around_the_limit = taken(perfect(range_max=5.0, **noisy), surrounding(5.0))
    assert 0.2 < np.mean(np.isposinf(around_the_limit)) < 0.8
    assert np.all((around_the_limit <= 5.0) | np.isposinf(around_the_limit))
    around_nothing = taken(perfect(range_min=0.0, **noisy), surrounding(0.005))
    assert np.all((around_nothing >= 0.0) | np.isneginf(around_nothing))


@pytest.mark.parametrize("resolution", [0.001, 0.002, 0.005, 0.01, 0.25])
def test_ranges_are_multiples_of_the_resolution_and_survive_a_log_of_three_decimals(resolution):
    laser = Laser.sick(resolution=resolution)
    ranges = np.concatenate([taken(laser, star_room(), poses_around(7)).ravel(), [78.29]])
    hits = ranges[np.isfinite(ranges)][:-1].astype(np.float32)
    restated = np.array([f"{value:.3f}" for value in hits]).astype(np.float32)
    np.testing.assert_array_equal(restated, hits)
    steps = hits.astype(float) / resolution
    np.testing.assert_allclose(steps, np.round(steps), atol=0.01)
    assert len(np.unique(np.round(steps))) > 5


def test_other_noise_levels_and_limits_trace_nothing_anew():
    taken(Laser.sick(), star_room())
    before = module._take_chunk._cache_size()
    taken(Laser.full_turn(BEAMS, noise=0.1, dropout=0.5, range_max=3.0), panels())
    assert module._take_chunk._cache_size() == before


def test_a_laser_may_be_made_where_its_values_are_traced():
    sigma = jax.jit(lambda noise: Laser.sick(noise=noise).noise)(np.float32(0.02))
    assert sigma == np.float32(0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"beams": 0}, "beams: 0"),
        ({"angle_min": np.inf}, "angle_min: inf"),
        ({"angle_increment": 0.0}, "angle_increment: 0.0"),
        ({"angle_increment": 0.1}, "angle_increment: at 0.1.* rad, 181 beams"),
        ({"range_min": -0.5}, "range_min: -0.5"),
        ({"range_min": 90.0}, "range_min: 90.0"),
        ({"range_max": np.nan}, "range_max: nan"),
        ({"resolution": 0.0}, "resolution: 0.0"),
        ({"resolution": 0.003}, "resolution: 0.003"),
        ({"bias": -1.0}, "bias: -1.0"),
        ({"noise": np.nan}, "noise: nan"),
        ({"noise_per_metre": np.inf}, "noise_per_metre: inf"),
        ({"dropout": 1.5}, "dropout: 1.5"),
        ({"divergence": 4.0}, "divergence: 4.0"),
        ({"mixed": -0.5}, "mixed: -0.5"),
        ({"mixed_step": -2.0}, "mixed_step: -2.0"),
    ],
)
def test_a_bad_laser_is_refused_by_field_and_value(changes, message):
    with pytest.raises(ValueError, match=message):
        Laser(**changes)


def test_every_number_of_a_laser_is_checked():
    for field in dataclasses.fields(Laser)[1:]:
        with pytest.raises(ValueError, match=f"^{field.name}: nan"):
            Laser(**{field.name: np.nan})


def test_the_sick_has_two_resolutions_and_a_full_turn_some_beams():
    with pytest.raises(ValueError, match=r"resolution_deg: 0\.3"):
        Laser.sick(0.3)
    with pytest.raises(ValueError, match="beams: 0"):
        Laser.full_turn(0)


@pytest.mark.parametrize(
    ("poses", "moving", "message"),
    [
        (np.zeros(3), None, r"T_world_laser: shape \(3,\)"),
        (np.zeros((2, 2)), None, r"T_world_laser: shape \(2, 2\)"),
        (np.zeros((0, 3)), None, "T_world_laser: there are no poses"),
        (np.array([[0, 0, 0], [0, np.nan, 0]]), None, r"T_world_laser\[1, 1\]: nan"),
        (np.zeros((2, 3)), np.zeros((2, 3)), r"moving: shape \(2, 3\)"),
        (np.zeros((2, 3)), np.zeros((3, 1, 3)), "moving: circles of 3 scans.* 2 poses"),
        (np.zeros((1, 3)), np.full((1, 1, 3), np.inf), r"moving\[0, 0, 0\]: inf"),
    ],
)
def test_bad_poses_and_moving_circles_are_refused_by_field_index_and_value(poses, moving, message):
    with pytest.raises(ValueError, match=message):
        take_scans(KEY, Laser.sick(), star_room(), moving, poses)


def test_where_a_process_allows_64_bits_scans_are_the_same_to_the_bit(wide):
    narrow = taken(Laser.sick(), panels())
    wide()
    np.testing.assert_array_equal(taken(Laser.sick(), panels()), narrow)
