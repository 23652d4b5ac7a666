import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.configuration import Packed
from aprjax.features import FeatureConfig
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.tracking import idc as module
from aprjax.tracking.idc import IdcConfig, idc
from aprjax.tracking.views import view_of
from tests.make_logs import _near
from tests.oracles import evaluation as poses
from tests.oracles import idc as oracle
from tests.worlds import free_pose, office, scan_at

PAIRS = 32
CONFIG = IdcConfig()


def views_of(scans):
    stacked = ReferenceSet.build(scans).index.features.view
    return jax.tree.map(lambda array: np.asarray(array)[: len(scans)], stacked)


def row(tree, index):
    return jax.tree.map(lambda array: array[index], tree)


@dataclasses.dataclass(frozen=True)
class Pairs:
    """Scans of an office, scans near them, and their true relative poses."""

    scans: list
    references: object
    queries: object
    T: np.ndarray

    def starts(self, seed=0, distance=0.3, angle=0.1745):
        rng = np.random.default_rng(seed)
        side, turn = rng.uniform(-np.pi, np.pi, len(self.T)), rng.choice([-1, 1], len(self.T))
        offsets = np.stack([distance * np.cos(side), distance * np.sin(side), angle * turn], -1)
        moved = [poses.compose(T, offset) for T, offset in zip(self.T, offsets, strict=True)]
        return np.array(moved, np.float32)


@pytest.fixture(scope="module")
def pairs():
    rng = np.random.default_rng(7)
    world = office(seed=3)
    here = [free_pose(world, rng) for _ in range(PAIRS)]
    there = [_near(world, pose, rng) for pose in here]
    scans = [scan_at(world, pose, noise=0.01, rng=rng) for pose in here + there]
    views = views_of(scans)
    T = np.array([poses.between(a, b) for a, b in zip(here, there, strict=True)])
    return Pairs(scans, row(views, slice(0, PAIRS)), row(views, slice(PAIRS, None)), T)


def errors(found, T):
    return np.array([poses.error(a, b) for a, b in zip(np.asarray(found), T, strict=True)]).T


def test_poses_are_found_from_three_decimetres_and_ten_degrees_off(pairs):
    found = [
        errors(
            idc(pairs.references, pairs.queries, pairs.starts(seed=s), CONFIG).T_ref_query,
            pairs.T,
        )
        for s in range(3)
    ]
    distance, angle = np.concatenate(found, axis=1)
    assert np.median(distance) < 0.03
    assert np.median(angle) < np.radians(0.3)
    assert np.mean((distance < 0.2) & (angle < np.radians(2))) >= 0.9


def test_closest_points_are_those_of_the_oracle(pairs):
    view = row(pairs.references, 0)
    xy = np.float32(np.random.default_rng(0).uniform(-3, 5, (40, 2)))
    found, gap = module._closest(module._surface(view), xy)
    expected = np.array([oracle.closest(view, point) for point in xy.astype(float)])
    np.testing.assert_allclose(gap, np.linalg.norm(expected - xy, axis=1), atol=1e-4)
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_points_of_the_same_range_are_those_of_the_oracle(pairs):
    view = row(pairs.references, 1)
    xy = np.float32(np.random.default_rng(0).uniform(-3, 5, (40, 2)))
    found, gap = module._same_range(module._surface(view), xy, jnp.float32(0.3), jnp.float32(0.1))
    none = 0
    for point, partner, off in zip(
        xy.astype(float), np.asarray(found), np.asarray(gap), strict=True
    ):
        expected = oracle.same_range(view, point, 0.3, 0.1)
        if expected is None:
            none += 1
            assert np.isinf(off)
        else:
            np.testing.assert_allclose(partner, expected, atol=5e-3)
    assert 0 < none < len(xy)


@pytest.mark.parametrize("index", range(2))
def test_a_step_is_that_of_the_oracle(pairs, index):
    reference, query = row(pairs.references, index), row(pairs.queries, index)
    start = pairs.starts()[index]
    config = IdcConfig(points=256)
    surfaces = module._surface(reference), module._surface(query)
    points = module._points(reference, 256), module._points(query, 256)
    found = module._step(surfaces, points, start, jnp.float32(0.8), jnp.float32(0.3), config)
    expected = oracle.step(reference, query, start, 0.8, 0.3, float(config.nearness))
    distance, angle = poses.error(np.asarray(found), expected)
    assert distance < 2e-3
    assert angle < 1e-3


def test_the_weighted_rigid_motion_is_that_of_the_singular_value_decomposition():
    rng = np.random.default_rng(0)
    start, weight = rng.normal(size=(30, 2)), rng.uniform(size=30)
    goal = start @ np.array([[0.8, 0.6], [-0.6, 0.8]]) + (0.3, -2.0) + rng.normal(size=(30, 2)) / 9
    turn, shift = module._rigid(*(jnp.float32(a) for a in (start, goal, weight)))
    expected_turn, expected_shift = oracle.rigid(start, goal, weight)
    np.testing.assert_allclose(turn, expected_turn, atol=1e-5)
    np.testing.assert_allclose(shift, expected_shift, atol=1e-5)


def test_the_true_pose_stays(pairs):
    found = idc(pairs.references, pairs.queries, np.float32(pairs.T), CONFIG)
    distance, angle = errors(found.T_ref_query, pairs.T)
    assert np.mean((distance < 0.05) & (angle < np.radians(0.5))) >= 0.9


def test_the_inverse_start_leads_to_the_inverse_pose(pairs):
    there = idc(pairs.references, pairs.queries, np.float32(pairs.T), CONFIG)
    T_back = np.array([poses.inverse(T) for T in pairs.T], np.float32)
    back = idc(pairs.queries, pairs.references, T_back, CONFIG)
    expected = [poses.inverse(T) for T in np.asarray(there.T_ref_query)]
    distance, angle = errors(back.T_ref_query, expected)
    assert np.mean((distance < 0.05) & (angle < np.radians(0.5))) >= 0.9


def test_a_turned_reference_frame_turns_the_pose(pairs):
    """A scanner mounted at another angle: its frame turns about the laser, the world does not."""
    turn = 0.5
    turned = [dataclasses.replace(s, angle_min=s.angle_min + np.float32(turn)) for s in pairs.scans]
    references = row(views_of(turned), slice(0, PAIRS))
    about = np.array([0.0, 0.0, turn])
    starts = pairs.starts()
    plain = idc(pairs.references, pairs.queries, starts, CONFIG)
    starts = np.array([poses.compose(about, T) for T in starts], np.float32)
    found = idc(references, pairs.queries, starts, CONFIG)
    expected = [poses.compose(about, T) for T in np.asarray(plain.T_ref_query)]
    distance, angle = errors(found.T_ref_query, expected)
    assert np.mean((distance < 0.01) & (angle < np.radians(0.1))) >= 0.9


def test_a_pair_ends_where_it_does_whatever_its_neighbours(pairs):
    starts = pairs.starts()
    plain = idc(pairs.references, pairs.queries, starts, CONFIG)
    order = np.random.default_rng(0).permutation(PAIRS)
    order[:4] = order[0]
    mixed = idc(row(pairs.references, order), row(pairs.queries, order), starts[order], CONFIG)
    np.testing.assert_allclose(mixed.T_ref_query, plain.T_ref_query[order], atol=1e-3)
    assert np.array_equal(mixed.converged, plain.converged[order])


def test_pairs_of_one_place_converge_and_pairs_of_different_places_do_not(pairs):
    starts = pairs.starts()
    same = idc(pairs.references, pairs.queries, starts, CONFIG)
    distance, angle = errors(same.T_ref_query, pairs.T)
    right = (distance < 0.2) & (angle < np.radians(2))
    elsewhere = jax.tree.map(lambda array: np.roll(array, PAIRS // 2, axis=0), pairs.queries)
    other = idc(pairs.references, elsewhere, starts, CONFIG)
    assert np.mean(np.asarray(same.converged)[right]) >= 0.9
    assert np.mean(other.converged) <= 0.25


def test_along_a_bare_corridor_the_covariance_is_long(pairs):
    walls = np.array([[[-60.0, 1.0], [60.0, 1.0]], [[-60.0, -1.2], [60.0, -1.2]]])
    rng = np.random.default_rng(0)
    scans = [scan_at(walls, np.array([x, 0.0, 0.0]), noise=0.01, rng=rng) for x in (0.0, 0.4)]
    views = views_of([*scans, *pairs.scans[2:]])
    references, queries = (row(views, np.full(PAIRS, k)) for k in (0, 1))
    starts = np.tile(np.float32([0.3, 0.1, 0.05]), (PAIRS, 1))
    found = row(idc(references, queries, starts, CONFIG), 0)
    along, across = np.sqrt(np.diag(np.asarray(found.covariance)))[:2]
    assert along > 20 * across
    assert abs(float(found.T_ref_query[1])) < 0.03
    assert abs(float(found.T_ref_query[2])) < np.radians(0.5)


def test_scans_without_hits_are_finite_and_not_converged_and_disturb_nobody(pairs):
    geometry = {"angle_min": -np.pi / 2, "angle_increment": np.pi / 180, "range_max": 30.0}
    odd = [
        Scan.make(np.full(181, np.nan), **geometry),
        Scan.make(np.full(181, np.inf), **geometry),
        Scan.make(np.array([2.0]), **geometry),
    ]
    starts = pairs.starts()
    plain = idc(pairs.references, pairs.queries, starts, CONFIG)
    # At one side, at the other, and at both.
    scans = list(pairs.scans)
    for k, scan in enumerate(odd):
        scans[k] = scans[PAIRS + k + 3] = scans[k + 6] = scans[PAIRS + k + 6] = scan
    views = views_of(scans)
    found = idc(row(views, slice(0, PAIRS)), row(views, slice(PAIRS, None)), starts, CONFIG)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(found))
    assert not np.any(found.converged[:9])
    np.testing.assert_allclose(found.T_ref_query[9:], plain.T_ref_query[9:], atol=1e-3)
    # One hit may still draw the other scan to it; without any, nothing moves.
    empty = np.array([0, 1, 3, 4, 6, 7])
    distance, angle = errors(found.T_ref_query[empty], starts[empty])
    assert np.all(distance < 1e-4)
    assert np.all(angle <= float(CONFIG.spread) + 1e-4)


def test_other_thresholds_compile_nothing_anew(pairs):
    idc(pairs.references, pairs.queries, pairs.starts(), CONFIG)
    before = module._idc._cache_size()
    for gate in (0.5, 0.9):
        config = IdcConfig(gate=gate, min_paired=0.3)
        idc(pairs.references, pairs.queries, pairs.starts(), config)
    assert module._idc._cache_size() == before


def test_where_a_process_allows_64_bits_poses_are_the_same_to_the_bit(pairs, wide):
    def found():
        view = view_of(pairs.scans[0], Packed.of(FeatureConfig()))
        return view, idc(pairs.references, pairs.queries, pairs.starts(), CONFIG)

    narrow = found()
    wide()
    jax.tree.map(np.testing.assert_array_equal, found(), narrow)
