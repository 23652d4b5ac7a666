import dataclasses

import jax
import numpy as np
import pytest

from aprjax.references import ReferenceSet
from aprjax.refine import RefineConfig, SettleConfig, _inverse, refine, settle
from aprjax.scan import Scan
from aprjax.sim.laser import Laser, take_scans
from aprjax.sim.world import World
from tests.make_logs import _near
from tests.oracles import evaluation as oracle
from tests.worlds import free_pose, office, scan_at

PAIRS = 8
fit = jax.jit(jax.vmap(refine, (0, 0, 0, None)))


def view_of(scans):
    return jax.tree.map(np.asarray, ReferenceSet.build(scans).index.features.view)


def row(tree, index):
    return jax.tree.map(lambda array: array[index], tree)


def pairs_of(noise):
    """Eight scans of an office, eight near them, and their true relative poses."""
    rng = np.random.default_rng(7)
    world = office(seed=3)
    here = [free_pose(world, rng) for _ in range(PAIRS)]
    there = [_near(world, pose, rng) for pose in here]
    scans = [scan_at(world, pose, noise=noise, rng=rng) for pose in here + there]
    views = view_of(scans)
    T = np.array([oracle.between(a, b) for a, b in zip(here, there, strict=True)])
    return row(views, slice(0, PAIRS)), row(views, slice(PAIRS, 2 * PAIRS)), T


@pytest.fixture(scope="module")
def exact():
    return pairs_of(noise=0.0)


@pytest.fixture(scope="module")
def noisy():
    return pairs_of(noise=0.01)


def starts(T, seed):
    """Poses 0.2 m and 5 degrees off the given ones, to random sides."""
    rng = np.random.default_rng(seed)
    side, turn = rng.uniform(-np.pi, np.pi, len(T)), rng.choice([-1, 1], len(T))
    offsets = np.stack([0.2 * np.cos(side), 0.2 * np.sin(side), np.radians(5) * turn], axis=-1)
    poses = [oracle.compose(pose, offset) for pose, offset in zip(T, offsets, strict=True)]
    return np.array(poses, np.float32)


def errors(found, T):
    return np.array([oracle.error(a, b) for a, b in zip(np.asarray(found), T, strict=True)])


def test_scans_without_noise_are_aligned_to_millimetres_from_two_decimetres_off(exact):
    first, second, T = exact
    found = [
        errors(fit(first, second, starts(T, seed), RefineConfig()).T_ref_query, T)
        for seed in range(8)
    ]
    distance, angle = np.concatenate(found).T
    turned = angle < np.radians(0.05)
    assert np.mean(turned & (distance < 0.002)) >= 0.7
    assert np.mean(turned & (distance < 0.005)) >= 0.9
    assert np.all(distance < 0.1)


def test_noisy_scans_are_aligned_to_about_a_centimetre(noisy):
    first, second, T = noisy
    distance, angle = errors(fit(first, second, starts(T, 0), RefineConfig()).T_ref_query, T).T
    assert np.all(distance < 0.03)
    assert np.all(angle < np.radians(0.5))


def test_the_true_pose_stays_where_it_is(exact):
    first, second, T = exact
    distance, angle = errors(
        fit(first, second, T.astype(np.float32), RefineConfig()).T_ref_query, T
    ).T
    assert np.all(distance < 0.005)
    assert np.all(angle < np.radians(0.1))


def test_points_lie_closer_to_the_surfaces_than_before(noisy):
    first, second, T = noisy
    start = starts(T, 3)
    found = np.asarray(fit(first, second, start, RefineConfig()).T_ref_query)
    for index in range(0, PAIRS, 2):
        reference, query = row(first, index), row(second, index)
        before = oracle.robust_cost(reference, query, start[index], gate=0.3)
        after = oracle.robust_cost(reference, query, found[index], gate=0.3)
        assert after < before


def test_the_inverse_alignment_is_refined_to_the_inverse_pose(noisy):
    first, second, T = noisy
    there = fit(first, second, T.astype(np.float32), RefineConfig())
    T_back = np.array([oracle.inverse(pose) for pose in T], np.float32)
    back = fit(second, first, T_back, RefineConfig())
    expected = [oracle.inverse(pose) for pose in np.asarray(there.T_ref_query)]
    distance, angle = errors(back.T_ref_query, expected).T
    assert np.all(distance < 0.03)
    assert np.all(angle < np.radians(0.5))


def test_covariances_are_symmetric_positive_definite_and_small_in_rooms(noisy):
    first, second, T = noisy
    covariance = np.asarray(fit(first, second, starts(T, 1), RefineConfig()).covariance, float)
    assert np.all(np.isfinite(covariance))
    size = np.abs(covariance).max(axis=(1, 2), keepdims=True)
    asymmetry = np.abs(covariance - covariance.swapaxes(1, 2))
    assert np.all(asymmetry <= 1e-5 * size)
    deviations = np.sqrt(np.linalg.eigvalsh(covariance))
    assert np.all(deviations > 0)
    assert np.median(deviations.max(axis=1)) < 0.05


@pytest.fixture(scope="module")
def simulated():
    """Two offices as a SICK sees them, 48 pairs each: errors of the poses, and covariances."""
    off, covariances = [], []
    for seed in (3, 4):
        rng = np.random.default_rng(seed)
        world = office(seed)
        here = [free_pose(world, rng) for _ in range(48)]
        poses = np.array(here + [_near(world, pose, rng) for pose in here])
        plan = World.make(world, np.zeros((0, 3)))
        scans = take_scans(jax.random.key(seed), Laser.sick(), plan, None, poses)
        views = ReferenceSet.build(scans).index.features.view
        T = np.array([oracle.between(*pair) for pair in zip(poses[:48], poses[48:], strict=True)])
        first, second = row(views, slice(0, 48)), row(views, slice(48, 96))
        refined = fit(first, second, starts(T, seed), RefineConfig())
        error = np.asarray(refined.T_ref_query) - T
        error[:, 2] = np.angle(np.exp(1j * error[:, 2]))
        off.append(error)
        covariances.append(np.asarray(refined.covariance, float))
    return np.concatenate(off), np.concatenate(covariances)


def test_a_simulated_laser_is_placed_to_half_a_centimetre(simulated):
    off, _ = simulated
    assert np.median(np.hypot(off[:, 0], off[:, 1])) < 0.005
    assert np.degrees(np.median(np.abs(off[:, 2]))) < 0.06


def test_covariances_are_consistent_with_the_errors_of_a_simulated_laser(simulated):
    """The mean of squared errors over their covariance is 3 for a perfect estimate of it."""
    off, covariance = simulated
    square = np.sum(off * np.linalg.solve(covariance, off[..., None])[..., 0], axis=-1)
    assert 2 <= np.mean(square) <= 4
    assert np.mean(square < 7.815) >= 0.9


def test_an_error_that_all_ranges_of_a_scan_share_does_not_move_the_pose():
    """Not where walls face each other, which it puts off to either side."""
    walls = np.array(
        [[[-3, -2], [3, -2]], [[3, -2], [3, 2]], [[3, 2], [-3, 2]], [[-3, 2], [-3, -2]]]
    )
    poses = np.array([[-1.0, 0.3, 0.2], [-0.8, 0.0, 0.4], [-0.6, -0.3, 0.0]])
    exact = [scan_at(walls, pose) for pose in poses]
    long = [dataclasses.replace(scan, ranges=scan.ranges + 0.015) for scan in exact]
    T = np.array([oracle.between(poses[0], pose) for pose in poses[1:]])
    views = view_of(exact + long)
    T = np.tile([oracle.between(poses[0], pose) for pose in poses[1:]], (PAIRS // 2, 1))
    first, second = row(views, np.zeros(PAIRS, int)), row(views, np.tile([4, 5], PAIRS // 2))
    distance, _ = errors(fit(first, second, starts(T, 0), RefineConfig()).T_ref_query, T).T
    assert np.all(distance < 0.005)
    ignored = RefineConfig(bias=1e-5)
    distance, _ = errors(fit(first, second, starts(T, 0), ignored).T_ref_query, T).T
    assert np.all(distance > 0.008)


def test_an_end_that_is_found_from_several_starts_is_one_pose(noisy):
    first, second, T = noisy
    ends = [fit(first, second, starts(T, seed), RefineConfig()).T_ref_query for seed in range(6)]
    close = [errors(end, np.asarray(ends[0], float)) for end in ends[1:]]
    distance, angle = np.concatenate(close).T
    assert np.mean(distance < 0.003) >= 0.8
    assert np.median(angle) < np.radians(0.02)


def test_settling_brings_a_pose_near(exact):
    first, second, T = exact
    coarse = jax.jit(jax.vmap(settle, (0, 0, 0, None)))
    settled = coarse(first, second, starts(T, 0), SettleConfig(points=48, iterations=3))
    distance, angle = errors(settled, T).T
    assert np.median(distance) < 0.01
    assert np.median(angle) < np.radians(0.2)


def test_residuals_beyond_the_errors_of_the_scanner_widen_the_covariance(noisy):
    """Neighbouring beams share what is no noise: it weighs more than a greater noise would."""
    first, second, T = noisy
    sure = fit(first, second, T.astype(np.float32), RefineConfig(cluster=0.0)).covariance
    precise = RefineConfig(noise=0.001, noise_per_metre=0.0, roughness=0.003)
    doubted = fit(first, second, T.astype(np.float32), precise).covariance
    size = [np.sqrt(np.trace(np.asarray(c), axis1=1, axis2=2)) for c in (sure, doubted)]
    assert np.median(size[1] / size[0]) > 1.5


@pytest.mark.parametrize(
    "name", ["gate", "final_gate", "bias", "roughness", "outlier", "trust", "prior"]
)
def test_at_the_least_of_what_divides_the_solve_is_a_solve(noisy, name):
    first, second, T = noisy
    (field,) = (f for f in dataclasses.fields(RefineConfig) if f.name == name)
    config = RefineConfig(**{name: field.metadata["least"]})
    refined = fit(first, second, T.astype(np.float32), config)
    distance, _ = errors(refined.T_ref_query, T).T
    assert np.all(distance < 0.1)
    covariance = np.asarray(refined.covariance, float)
    assert np.all(np.linalg.eigvalsh(covariance) > 0)


@pytest.mark.parametrize("heading", [0.0, 0.3, 0.8, 1.2])
def test_a_corridor_holds_the_pose_across_but_not_along(heading):
    rng = np.random.default_rng(4)
    walls = np.array([[[-200, -1.0], [200, -1.0]], [[-200, 1.2], [200, 1.2]]])
    # Scans that look along the corridor, one way or the other, or at a wall.
    poses = [np.array([0.0, 0.0, heading + turn]) for turn in (0.0, np.pi / 2, np.pi, 1.9)]
    moved = [oracle.compose([0.2, 0.05, 0.0], pose) for pose in poses]
    scans = [scan_at(walls, pose, noise=0.01, rng=rng) for pose in (*poses, *moved)]
    views = view_of(scans)
    first, second = (row(views, np.tile(np.arange(k, k + 4), 2)) for k in (0, 4))
    T = np.array([oracle.between(a, b) for a, b in zip(poses, moved, strict=True)])
    refined = fit(first, second, np.tile(T, (2, 1)).astype(np.float32), RefineConfig())
    for pose, covariance in zip(poses, np.asarray(refined.covariance, float)[:4], strict=True):
        assert np.all(np.linalg.eigvalsh(covariance) > 0)
        variance, direction = np.linalg.eigh(covariance[:2, :2])
        along = [np.cos(pose[2]), -np.sin(pose[2])]  # the corridor's direction in the scan's frame
        assert abs(direction[:, 1] @ along) > 0.99
        assert np.sqrt(variance[1]) > 10 * np.sqrt(variance[0])
        assert np.sqrt(variance[1]) > 0.1


def test_scans_with_nothing_in_common_stay_where_they_are_put(noisy):
    first, *_ = noisy
    nothing = Scan.make(
        np.full(181, np.nan), angle_min=-np.pi / 2, angle_increment=np.pi / 180, range_max=30.0
    )
    empty = row(view_of([nothing]), np.zeros(PAIRS, int))
    start = np.random.default_rng(0).normal(0, 1, (PAIRS, 3)).astype(np.float32)
    for reference, query in ((first, empty), (empty, first), (empty, empty)):
        refined = fit(reference, query, start, RefineConfig())
        np.testing.assert_allclose(refined.T_ref_query, start, atol=1e-6)
        assert np.all(np.linalg.eigvalsh(np.asarray(refined.covariance, float)) > 0)
        assert np.all(np.diagonal(refined.covariance, axis1=1, axis2=2) > 0.1)


def test_any_views_give_finite_poses_and_positive_definite_covariances():
    wall = np.array([[[-50.0, 2.0], [50.0, 2.0]]])
    poses = [np.array([0.0, 0.0, angle]) for angle in (np.pi / 2, 0.3, -np.pi / 2)]
    scans = [scan_at(wall, pose) for pose in poses]
    at_one_place = np.full(181, np.nan)
    at_one_place[90:92] = 1e-3
    odd = [at_one_place, np.full(181, 29.9), np.full(181, np.inf)]
    geometry = {"angle_min": -np.pi / 2, "angle_increment": np.pi / 180, "range_max": 30.0}
    scans += [Scan.make(ranges, **geometry) for ranges in odd]
    scans.append(Scan.make(np.array([2.0]), **geometry))
    views = view_of([scan.pad(256) for scan in scans])
    one, other = (index.ravel() for index in np.indices((len(scans), len(scans))))
    for start in ([0.0, 0.0, 0.0], [0.1, -0.05, 0.02], [1e3, -1e3, 3.0]):
        starts = np.tile(np.float32(start), (len(one), 1))
        refined = fit(row(views, one), row(views, other), starts, RefineConfig())
        assert np.all(np.isfinite(refined.T_ref_query))
        covariance = np.asarray(refined.covariance, float)
        assert np.all(np.isfinite(covariance))
        assert np.all(np.linalg.eigvalsh(covariance) > 0)
        np.testing.assert_allclose(covariance, covariance.swapaxes(1, 2), rtol=1e-4, atol=1e-8)


def test_a_small_matrix_is_inverted_as_by_lapack():
    factors = np.random.default_rng(0).normal(size=(6, 5, 5))
    matrices = factors @ factors.transpose(0, 2, 1) + 0.1 * np.eye(5)
    found = jax.vmap(_inverse)(matrices.astype(np.float32))
    np.testing.assert_allclose(found, np.linalg.inv(matrices), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("matrix", [np.zeros((5, 5)), np.ones((5, 5)), np.diag([1, 1, 0, 1, 1])])
def test_the_inverse_of_a_singular_matrix_is_finite_and_positive(matrix):
    found = np.asarray(_inverse(matrix.astype(np.float32)), float)
    assert np.all(np.isfinite(found))
    assert np.all(np.diag(found) > 0)
