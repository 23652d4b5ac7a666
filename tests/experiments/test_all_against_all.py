from typing import Any

import numpy as np
import pytest

from aprjax.result import MatchResult
from experiments.all_against_all import at_most, chosen, curve

# Three scans, metres apart. Alternatives name scan 0, at which the truth of each is then as given.
TRUTH = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.5], [4.0, 1.0, -1.0]])


@pytest.fixture(scope="module")
def choices():
    """Scan 0: the best of e_m is right, the most anchors are wrong. Scan 1: the other way round,
    and just right. Scan 2: nothing is right, and one alternative is none."""
    poses = [
        [[0.1, 0.1, 0.1], [3.0, 0.0, 0.0]],
        [[0.0, 0.0, 0.5], [2.0, 0.49, 0.31]],
        [[4.0, 1.0, -0.79], [4.0, 1.0, -1.0]],
    ]
    fields: dict[str, Any] = dict.fromkeys(MatchResult.__dataclass_fields__)
    fields |= {
        "reference": np.array([[0, 0], [0, 0], [0, -1]]),
        "T_ref_query": np.array(poses),
        "quality": np.array([[0.5, 0.4], [0.3, 0.2], [0.1, 0.0]]),
        "agreeing_anchors": np.array([[4, 9], [5, 7], [6, 0]]),
        "valid": np.array([[True, True], [True, True], [True, False]]),
    }
    return chosen(MatchResult(**fields), TRUTH)


def test_each_way_chooses_by_its_own_score(choices):
    scores, right = choices["quality"]
    assert (scores.tolist(), right.tolist()) == ([0.5, 0.3, 0.1], [True, False, False])
    scores, right = choices["anchors"]
    assert (scores.tolist(), right.tolist()) == ([9, 7, 6], [False, True, False])
    scores, right = choices["oracle"]
    assert (scores.tolist(), right.tolist()) == ([0.5, 0.2, 0.1], [True, True, False])


def test_a_curve_counts_answers_of_at_least_each_threshold():
    score = np.array([0.5, 0.2, 0.5, 0.0, 0.3])
    right = np.array([True, True, False, False, True])
    thresholds, hits, wrong = curve(score, right)
    np.testing.assert_allclose(thresholds, [0.5, 0.3, 0.2])
    np.testing.assert_allclose(hits, [0.2, 0.4, 0.6])
    np.testing.assert_allclose(wrong, [0.2, 0.2, 0.2])
    assert at_most(0.2, hits, wrong) == pytest.approx(0.6)
    assert at_most(0.1, hits, wrong) == 0.0
