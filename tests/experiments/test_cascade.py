from typing import Any

import numpy as np

from aprjax.result import MatchResult
from experiments.cascade import differing, row
from experiments.data import Split

RIGHT, NEAR, WRONG = (0.0, 0.0, 0.0), (0.05, 0.0, 0.01), (5.0, 0.0, 0.0)


def result(poses, quality, references=None, valid=None) -> MatchResult:
    """One hypothesis for each query."""
    count = len(quality)
    fields: dict[str, Any] = dict.fromkeys(MatchResult.__dataclass_fields__)
    fields |= {
        "reference": np.reshape([0] * count if references is None else references, (count, 1)),
        "T_ref_query": np.reshape(np.array(poses, float), (count, 1, 3)),
        "quality": np.reshape(quality, (count, 1)),
        "valid": np.reshape([True] * count if valid is None else valid, (count, 1)),
    }
    return MatchResult(**fields)


def test_answers_differ_in_reference_pose_or_being_there():
    first = result([RIGHT] * 5, [0.5] * 5, valid=[True, True, True, True, False])
    second = result(
        [RIGHT, NEAR, WRONG, RIGHT, WRONG],
        [0.5] * 5,
        references=[0, 0, 0, 1, 0],
        valid=[True, True, True, True, False],
    )
    assert differing(first, second).tolist() == [False, False, True, True, False]
    nothing = result([RIGHT] * 5, [0.0] * 5, valid=[False] * 5)
    assert differing(first, nothing).tolist() == [True, True, True, True, False]


def test_a_row_says_what_is_right_only_on_one_side_and_what_was_lost():
    scans: Any = None
    split = Split("x", scans, scans, np.zeros((1, 3)), np.zeros((4, 3)), np.ones(4, bool))
    with_ = result([RIGHT, WRONG, RIGHT, WRONG], [0.9, 0.2, 0.8, 0.3])
    without = result([RIGHT, RIGHT, WRONG, WRONG], [0.9, 0.6, 0.9, 0.3])
    found = row(split, np.zeros(1, int), with_, without)
    assert (found["top1"], found["top1_all"]) == (0.5, 0.5)
    assert (found["differ"], found["lost"]) == (2, 2)
    assert (found["right_only_with"], found["right_only_without"]) == (1, 1)
    # 0.9 and 0.8 are right, and one wrong one is let pass; without, 0.9 twice holds it.
    assert (found["hits"], found["hits_all"]) == (0.5, 0.5)
