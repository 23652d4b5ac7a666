from dataclasses import replace

import jax
import numpy as np
import pytest

from aprjax.evaluation.signature import (
    BINS,
    discriminant,
    likeness,
    pair_histogram,
    signature,
)
from aprjax.features import FeatureConfig, seen
from aprjax.scan import Scan
from tests.oracles import signature as oracle
from tests.worlds import free_pose, office, scan_at


@jax.jit
def views_of(scans):
    return jax.vmap(seen, (0, None))(scans, FeatureConfig())


histograms = jax.jit(jax.vmap(pair_histogram))
signatures = jax.jit(jax.vmap(signature, (0, None)))


@pytest.fixture(scope="module")
def scans():
    rng, world = np.random.default_rng(1), office(seed=3)
    places = [free_pose(world, rng) for _ in range(6)]
    near = [pose + np.array([0.15, -0.1, 0.2]) for pose in places]
    return Scan.stack([scan_at(world, pose) for pose in (*places, *near)])


def test_the_histogram_is_that_of_a_loop_over_all_pairs(scans):
    views = jax.device_get(views_of(scans))
    found = np.asarray(histograms(views))
    for row in range(len(found)):
        expected = oracle.pair_histogram(jax.tree.map(lambda a: a[row], views))  # noqa: B023
        # A pair at the border of a bin may fall to either side of it.
        assert np.sum(np.abs(found[row] ** 2 - expected**2)) < 0.02


def test_places_are_more_alike_to_themselves_from_nearby_than_to_others(scans):
    found = np.asarray(signatures(views_of(scans), discriminant()))
    np.testing.assert_allclose(np.sum(found**2, axis=1), 1.0, atol=1e-5)
    likeness = found[6:] @ found[:6].T
    assert np.argmax(likeness, axis=1).tolist() == list(range(6))


def test_padding_changes_nothing(scans):
    wider = np.asarray(histograms(views_of(scans.pad(256))))
    np.testing.assert_allclose(wider, np.asarray(histograms(views_of(scans))), atol=1e-6)


def test_the_frame_of_the_scanner_plays_no_part(scans):
    views = jax.device_get(views_of(scans))
    cos, sin = np.cos(2.0), np.sin(2.0)
    turn = np.array([[cos, sin], [-sin, cos]], np.float32)
    moved = replace(
        views,
        xy=np.where(views.hit[..., None], views.xy @ turn + np.float32([3.0, -1.0]), 0.0),
        normal=views.normal @ turn,
    )
    gap = np.asarray(histograms(moved)) ** 2 - np.asarray(histograms(views)) ** 2
    assert np.max(np.sum(np.abs(gap), axis=1)) < 0.02


def test_a_scan_without_surfaces_has_no_signature():
    blank = Scan.stack(
        [Scan.make(np.full(181, np.nan), angle_min=0.0, angle_increment=0.01, range_max=8.0)]
    )
    assert not np.any(np.asarray(signatures(views_of(blank), discriminant())))
    assert discriminant().mean.shape == (BINS,)


def test_likeness_is_one_to_itself_none_to_a_blank_and_never_beyond():
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(6, 32)).astype(np.float32)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors[4] = 0
    found = np.asarray(likeness(vectors, vectors[2]))
    np.testing.assert_allclose(found, vectors @ vectors[2], atol=1e-6)
    assert found[2] == pytest.approx(1)
    assert found[4] == 0
    assert (np.abs(found) <= 1 + 1e-6).all()
