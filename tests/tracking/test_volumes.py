"""Volumes of hypotheses against samples of the normal distributions that they stand for."""

import numpy as np
import pytest

from aprjax.tracking.hypothesis import VolumeConfig, share_held

CONFIG = VolumeConfig()


def covariance(along, across, turn, direction=0.0):
    """That of deviations along and across a direction, in metres, and of the heading's."""
    axes = np.array(
        [[np.cos(direction), -np.sin(direction)], [np.sin(direction), np.cos(direction)]]
    )
    made = np.diag([0.0, 0.0, turn**2])
    made[:2, :2] = axes @ np.diag([along**2, across**2]) @ axes.T
    return made


def sampled(of):
    """The share of samples within the largest volume, of those in one without bounds."""
    rng = np.random.default_rng(0)
    off = rng.multivariate_normal(np.zeros(3), of, 200_000)
    gone, turn = np.hypot(off[:, 0], off[:, 1]), np.abs((off[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    radius = CONFIG.radius + CONFIG.deviations * np.sqrt(of[0, 0] + of[1, 1])
    angle = CONFIG.angle + CONFIG.deviations * np.sqrt(of[2, 2])
    bounded = (gone <= CONFIG.largest) & (turn <= CONFIG.widest)
    return np.mean(bounded) / np.mean((gone <= radius) & (turn <= angle))


@pytest.mark.parametrize("direction", [0.0, 1.0])
@pytest.mark.parametrize("along", [2.0, 4.0, 8.0])
@pytest.mark.parametrize("across", [0.0, 0.5])
@pytest.mark.parametrize("turn", [0.1, 2.0, 8.0])
def test_a_volume_at_its_bounds_holds_what_samples_say(direction, along, across, turn):
    of = covariance(along, across, turn, direction)
    assert share_held(of, CONFIG) == pytest.approx(sampled(of), abs=0.03)


@pytest.mark.parametrize("deviation", [2.0, 4.0])
def test_alike_in_all_directions_it_is_a_square_that_holds_little_more(deviation):
    of = covariance(deviation, deviation, 0.1)
    assert 0 < share_held(of, CONFIG) - sampled(of) < 0.15


def test_within_its_bounds_a_volume_holds_all_and_loses_nothing_at_once():
    bound = (CONFIG.largest - CONFIG.radius) / CONFIG.deviations
    assert share_held(covariance(0.999 * bound, 0.0, 0.1), CONFIG) == 1
    assert share_held(covariance(1.001 * bound, 0.0, 0.1), CONFIG) == pytest.approx(1, abs=1e-3)


def test_the_farther_the_less_is_held():
    shares = [
        share_held(covariance(along, along / 3, 0.1), CONFIG) for along in np.geomspace(1, 1e4, 20)
    ]
    assert np.all(np.diff(shares) <= 0)
    assert shares[0] == 1
    assert 0 < shares[-1] < 1e-6
