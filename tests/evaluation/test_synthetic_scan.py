import dataclasses

import jax
import numpy as np
import pytest

from aprjax.evaluation.synthetic_scan import synthetic_scan
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from tests.oracles import evaluation as oracle
from tests.worlds import cast, office

SLOTS = 192
synthetic = jax.jit(jax.vmap(synthetic_scan))

# First bearing and step in degrees, beams.
SCANNERS = {
    "half turn": (-90, 1.0, 181),
    "half turn upside down": (90, -1.0, 181),
    "narrow, looking left": (60, 0.5, 120),
    "full turn": (-180, 2.0, 180),
    "full turn upside down": (35, -2.0, 180),
    "three quarters": (-135, 1.5, 181),
}
POSES = np.array([[6.0, 0.1, 0.7], [6.4, -0.2, 0.4], [5.3, 0.4, 2.0], [7.5, 0.0, -2.5]])


def scanner(name, world, pose):
    first, step, beams = SCANNERS[name]
    angle_min, increment = np.radians([first, step])
    ranges = cast(world, pose, angle_min + increment * np.arange(beams))
    return Scan.make(ranges, angle_min=angle_min, angle_increment=increment, range_max=30.0)


def view_of(scans):
    return jax.tree.map(np.asarray, ReferenceSet.build(scans).index.features.view)


def bearings_of(view):
    return view.angle_min[:, None] + np.arange(SLOTS) * view.angle_increment[:, None]


def row(view, index):
    return jax.tree.map(lambda array: array[index], view)


@pytest.fixture(scope="module")
def scans():
    """Every scanner at the first pose of a world, in one stack of eight."""
    world = office(seed=3)
    names = [*SCANNERS, "half turn", "half turn"]
    return view_of([scanner(name, world, POSES[0]) for name in names])


@pytest.mark.parametrize("pose", POSES[1:], ids=["near", "turned", "opposite"])
def test_ranges_are_those_of_an_explicit_intersection_of_rays_and_pieces(scans, pose):
    T = oracle.between(pose, POSES[0])
    bearings = bearings_of(scans)
    got = np.asarray(
        synthetic(scans, np.tile(T, (8, 1)).astype(np.float32), bearings.astype(np.float32))
    )
    claimed = []
    for index, name in enumerate(SCANNERS):
        beams = slice(0, SLOTS, 3)
        expected = 1 / oracle.synthetic_ranges(row(scans, index), T, bearings[index, beams])
        off = np.abs(got[index, beams] - expected)
        # A ray through the very end of a surface may fall on either side of it.
        assert np.mean(off > 1e-3 * np.maximum(expected, 0.1)) < 0.02, name
        claimed.append(np.mean(expected > 0))
    assert np.mean(claimed) > 0.2


@pytest.mark.parametrize("slots", [181, 185, 199])
def test_how_many_slots_a_view_has_makes_no_difference(scans, slots):
    view = row(scans, [0])
    names = ("xy", "range", "hit", "linked", "normal")
    cut = {name: getattr(view, name)[:, :181] for name in names}
    other = dataclasses.replace(view, **cut).pad(slots)
    T = oracle.between(POSES[1], POSES[0])[None].astype(np.float32)
    bearings = bearings_of(scans)[[0]].astype(np.float32)
    wanted = np.asarray(synthetic(view, T, bearings))
    assert (wanted > 0).sum() > 100
    np.testing.assert_array_equal(synthetic(other, T, bearings), wanted)


def test_from_its_own_place_a_scan_is_reproduced(scans):
    bearings = bearings_of(scans).astype(np.float32)
    got = np.asarray(synthetic(scans, np.zeros((8, 3), np.float32), bearings))
    inside = scans.linked & np.roll(scans.linked, 1, axis=1)
    inside[:, 0] = False
    assert np.all(inside.sum(axis=1) > 80)
    np.testing.assert_allclose(1 / got[inside], scans.range[inside], rtol=1e-4)
    known = scans.hit & (got > 0)
    np.testing.assert_allclose(1 / got[known], scans.range[known], rtol=1e-4)


def test_where_a_sweep_starts_makes_no_difference_to_a_full_turn():
    """The same closed room, its beams listed from eight different ones on."""
    room = np.array([[[0, 0], [5, 0]], [[5, 0], [5, 3]], [[5, 3], [0, 3]], [[0, 3], [0, 0]]], float)
    whole = scanner("full turn", room, np.array([2.0, 1.0, 0.3]))
    shifts = [0, 1, 20, 45, 90, 119, 160, 179]
    rolled = [
        Scan.make(
            np.roll(whole.ranges, -shift),
            angle_min=float(whole.angle_min + shift * whole.angle_increment),
            angle_increment=float(whole.angle_increment),
            range_max=30.0,
        )
        for shift in shifts
    ]
    bearings = np.linspace(-3, 3, SLOTS, dtype=np.float32)
    poses = np.tile(np.float32([0.4, 0.3, 0.5]), (8, 1))
    got = np.asarray(synthetic(view_of(rolled), poses, np.tile(bearings, (8, 1))))
    known = np.all(got > 0, axis=0)
    assert known.mean() > 0.95
    np.testing.assert_allclose(got[:, known], got[:1, known].repeat(8, axis=0), rtol=1e-4)


def test_the_nearer_of_two_surfaces_hides_the_other():
    """Seen from the right, the panel stands before the wall; from the overview, beside it."""
    panel_and_wall = np.array([[[-6, 4], [6, 4]], [[1, 2], [2, 2]]], float)
    view = view_of([scanner("half turn", panel_and_wall, np.array([0, 0, np.pi / 2]))] * 8)
    front = np.array([1.5, 0.0, np.pi / 2])
    T = oracle.between(front, np.array([0, 0, np.pi / 2]))
    bearings = np.tile(np.linspace(-0.6, 0.6, SLOTS, dtype=np.float32), (8, 1))
    inverse_range = synthetic(view, np.tile(T, (8, 1)).astype(np.float32), bearings)
    depth = np.cos(bearings[0]) / np.maximum(np.asarray(inverse_range)[0], 1e-9)
    np.testing.assert_allclose(depth[np.abs(bearings[0]) < 0.15], 2.0, atol=1e-3)
    np.testing.assert_allclose(depth[bearings[0] > 0.5], 4.0, atol=1e-3)


def test_a_wall_is_not_seen_from_behind():
    wall = np.array([[[2, -3], [2, 3]]], float)
    view = view_of([scanner("half turn", wall, np.zeros(3))] * 8)
    behind = oracle.inverse([4.0, 0.0, np.pi])
    bearings = np.tile(np.linspace(-3.1, 3.1, SLOTS, dtype=np.float32), (8, 1))
    assert not np.any(synthetic(view, np.tile(behind, (8, 1)).astype(np.float32), bearings))


def test_a_scan_without_hits_claims_nothing():
    empty = Scan.make(
        np.full(181, np.inf), angle_min=-np.pi / 2, angle_increment=np.pi / 180, range_max=30.0
    )
    bearings = np.tile(np.linspace(-1, 1, SLOTS, dtype=np.float32), (8, 1))
    assert not np.any(synthetic(view_of([empty] * 8), np.zeros((8, 3), np.float32), bearings))
