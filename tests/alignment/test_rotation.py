import jax
import numpy as np
import pytest

from aprjax.alignment.rotation import RotationConfig, rotation_peaks
from aprjax.relations.histograms import RelationConfig, direction_spectrum, matching_angles
from tests.oracles.alignment import apart
from tests.relations.graphs import graph, moved, scattered, stacked

BINS = 60
BIN = np.pi / BINS
peaks_of = jax.jit(rotation_peaks, static_argnums=1)


@jax.jit
def histogram_of(query, reference):
    config = RelationConfig()
    queries, references = (direction_spectrum(graph, config)[None] for graph in (query, reference))
    return matching_angles(queries, references, config)[0, 0]


def histogram(**votes):
    """Votes by bin."""
    counts = np.zeros(BINS, np.float32)
    for name, count in votes.items():
        counts[int(name[1:])] = count
    return counts


def assert_offers(rotations, angle, tolerance=1e-5):
    gaps = [apart(float(found), angle, 2 * np.pi) for found in rotations.angle]
    assert min(gaps) <= tolerance, np.degrees(rotations.angle)


@pytest.mark.parametrize("degrees", [-170, -91, -45, 0, 1, 30, 89.5, 123, 180])
def test_a_known_rotation_is_recovered_and_both_half_turns_are_offered(degrees):
    angle = np.radians(degrees)
    xy = scattered(5, 12)
    query = graph(moved((0.5, -1.0, -angle), xy))
    rotations = peaks_of(histogram_of(query, graph(xy)), RotationConfig())
    best = np.flatnonzero(rotations.votes == rotations.votes.max())
    assert len(best) == 2
    a, b = np.asarray(rotations.angle)[best]
    assert apart(a - b, np.pi, 2 * np.pi) < 1e-5
    assert min(apart(a, angle, 2 * np.pi), apart(b, angle, 2 * np.pi)) < BIN / 2


def test_a_peak_lies_at_the_mean_of_its_bins():
    rotations = peaks_of(histogram(b9=1, b10=6, b11=3), RotationConfig(peaks=1))
    assert_offers(rotations, (10 + 2 / 10) * BIN)
    assert_offers(rotations, (10 + 2 / 10) * BIN + np.pi)
    assert np.asarray(rotations.votes).tolist() == [10, 10]


def test_a_peak_may_lie_across_the_ends_of_the_histogram():
    rotations = peaks_of(histogram(b59=4, b0=4, b1=1), RotationConfig(peaks=1))
    # The middle bin is 0: a rotation a little below none, or below half a turn.
    assert_offers(rotations, -3 / 9 * BIN)
    assert_offers(rotations, np.pi - 3 / 9 * BIN)


def test_several_peaks_come_most_votes_first_in_each_half_turn():
    counts = histogram(b5=3, b20=9, b40=6)
    rotations = peaks_of(counts, RotationConfig(peaks=3))
    assert np.asarray(rotations.votes).tolist() == [9, 6, 3, 9, 6, 3]
    np.testing.assert_allclose(rotations.angle[:3], np.array([20, 40, 5]) * BIN, atol=1e-5)
    np.testing.assert_allclose(rotations.angle[3:] - rotations.angle[:3], np.pi, atol=1e-5)


def test_the_flank_of_a_peak_is_no_second_peak():
    rotations = peaks_of(histogram(b19=5, b20=9, b21=5, b22=2, b40=3), RotationConfig(peaks=2))
    assert_offers(rotations, 40 * BIN)


def test_an_empty_histogram_has_no_votes_and_finite_rotations():
    rotations = peaks_of(histogram(), RotationConfig())
    assert not np.asarray(rotations.votes).any()
    assert np.isfinite(rotations.angle).all()


def test_a_histogram_of_one_peak_has_no_votes_for_a_second():
    rotations = peaks_of(histogram(b30=4), RotationConfig(peaks=2))
    assert np.asarray(rotations.votes).tolist() == [4, 0, 4, 0]


def test_a_square_offers_all_four_rotations():
    corners = moved((0, 0, 0.3), [(1, 1), (-1, 1), (-1, -1), (1, -1)])
    query = graph(moved((2.0, 1.0, 0.5), corners))
    rotations = peaks_of(histogram_of(query, graph(corners)), RotationConfig())
    assert len(set(np.asarray(rotations.votes).tolist())) == 1
    for quarter in range(4):
        assert_offers(rotations, -0.5 + quarter * np.pi / 2, BIN / 2)


def test_rotations_under_vmap_are_those_one_by_one():
    counts = np.random.default_rng(0).integers(0, 9, (5, BINS)).astype(np.float32)
    together = jax.vmap(lambda h: rotation_peaks(h, RotationConfig()))(counts)
    alone = stacked([peaks_of(row, RotationConfig()) for row in counts])
    np.testing.assert_allclose(together.angle, alone.angle, atol=1e-6)
