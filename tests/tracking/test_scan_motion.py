"""Scan matching as tracking source, with its kernels; `test_sources` has its rules without."""

import json
from itertools import pairwise

import jax
import numpy as np
import pytest

from aprjax.configuration import Packed
from aprjax.features import FeatureConfig
from aprjax.plane import compose, relative
from aprjax.tracking.hypothesis import Step
from aprjax.tracking.scan_motion import ScanMotion
from aprjax.tracking.views import view_of
from tests.worlds import free_pose, office, scan_at


@pytest.fixture(scope="module")
def drive():
    """Three scans, half a metre and 11° apart, and the steps between them."""
    rng, world = np.random.default_rng(3), office(seed=1)
    poses = [free_pose(world, rng)]
    for turn in (0.2, -0.2):
        poses.append(compose(poses[-1], np.array([0.4, 0.1, turn])))
    scans = [scan_at(world, pose, rng=rng) for pose in poses]
    return scans, [relative(*pair) for pair in pairwise(poses)]


def expected(T_before_now):
    """What wheels say: 10 cm and 3° off."""
    return Step(T_before_now + [0.1, 0.0, 0.05], np.diag(np.square([0.1, 0.1, 0.05])))  # noqa: RUF005


def test_the_step_is_measured_to_centimetres(drive):
    scans, steps = drive
    source = ScanMotion()
    assert source.step(scans[0], None) is None
    for scan, T_before_now in zip(scans[1:], steps, strict=True):
        step = source.step(scan, expected(T_before_now))
        np.testing.assert_allclose(step.T_before_now, T_before_now, atol=0.02)


def test_a_restored_source_measures_the_same_step_to_the_bit(drive):
    scans, steps = drive
    source, restored = ScanMotion(), ScanMotion()
    source.step(scans[0], None)
    source.step(scans[1], expected(steps[0]))
    restored.restore(json.loads(json.dumps(source.state())))
    went_on, again = (each.step(scans[2], expected(steps[1])) for each in (source, restored))
    np.testing.assert_array_equal(went_on.T_before_now, again.T_before_now)
    np.testing.assert_array_equal(went_on.covariance, again.covariance)


def test_views_stay_on_the_device(drive):
    view = view_of(drive[0][0], Packed.of(FeatureConfig()))
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(view))
