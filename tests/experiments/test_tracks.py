import numpy as np
import pytest

from aprjax.io.tables import HypothesisRow
from experiments.tracks import Track, score

BUILD = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, np.pi / 2]])


def track(kidnapped=()):
    """Ten scans a metre apart along x from the first build scan, which maps the first two."""
    poses = np.array([[1.0 * k, 0.0, 0.0] for k in range(10)])
    return Track(BUILD, poses, np.array([0, *kidnapped]))


def row(scan, x, *, probability=0.9, theta=0.0, rank=0):
    pose = np.array([x, 0.0, theta])
    return HypothesisRow(scan, rank, 0, pose, 0.5, 0.1, probability, 1 - probability)


def table(errors, **changes):
    """The strongest hypotheses so far off along x, told from the first build scan."""
    return [row(k, k + error, **changes) for k, error in enumerate(errors)]


def test_scans_near_a_build_scan_that_looks_the_same_way_are_mapped():
    np.testing.assert_array_equal(track().mapped, [True, True, *[False] * 8])


def test_right_counts_mapped_scans_and_wrong_ones_all():
    figures = score(track(), table([0.1, 0.6, *[0.0] * 6, 3.0, 3.0]))
    assert figures["right"] == figures["committed_right"] == 0.5
    assert figures["committed_wrong"] == pytest.approx(0.3)
    assert figures["first_fix_m"] == 0.0


def test_who_is_not_committed_is_neither_committed_right_nor_wrong():
    figures = score(track(), table([0.0] * 5 + [2.0] * 5, probability=0.4))
    assert (figures["right"], figures["committed_right"], figures["committed_wrong"]) == (1, 0, 0)
    assert figures["first_fix_m"] == 9.0


def test_a_heading_that_is_off_is_wrong_and_lower_ranks_count_for_nothing():
    rows = table([0.0] * 10, theta=np.radians(11))
    rows += [row(0, 0.0, rank=1, probability=0.1)]
    assert score(track(), rows)["right"] == 0.0


def test_recovery_is_the_way_after_a_kidnapping_and_the_whole_piece_where_there_is_none():
    errors = [0.0] * 3 + [9.0, 9.0, 0.0] + [9.0] * 4
    figures = score(track(kidnapped=(3, 6)), table(errors))
    assert figures["recovered"] == "1 of 2"
    # Two metres in the second piece, three of the third.
    assert (figures["recovery_m"], figures["worst_m"]) == (2.5, 3.0)


def test_a_scan_without_hypotheses_is_not_right():
    rows = [HypothesisRow(k, 0, rest=1.0) for k in range(10)]
    figures = score(track(), rows)
    assert (figures["right"], figures["committed_wrong"]) == (0.0, 0.0)
