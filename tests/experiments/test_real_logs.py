from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aprjax.result import MatchResult
from aprjax.scan import Scan
from experiments.data import Split
from experiments.real_logs import SIX, Outcome, seen_points, table
from tests.worlds import clearance, office, scan_at

RIGHT, WRONG = (0.1, 0.0, 0.0), (5.0, 0.0, 0.0)


def outcome(name: str, best, quality) -> Outcome:
    """Of a split with one reference, all queries taken where it was; `best` are their answers."""
    count = len(quality)
    fields: dict[str, Any] = dict.fromkeys(MatchResult.__dataclass_fields__)
    fields |= {
        "reference": np.zeros((count, 1), int),
        "T_ref_query": np.reshape(best, (count, 1, 3)),
        "quality": np.reshape(quality, (count, 1)),
        "probability": np.ones((count, 1)),
        "valid": np.ones((count, 1), bool),
        "confident": np.asarray(quality) > 0.4,
    }
    scans: Any = None
    split = Split(name, scans, scans, np.zeros((1, 3)), np.zeros((count, 3)), np.ones(count, bool))
    references: Any = SimpleNamespace(ids=np.zeros(1, int))
    return Outcome(
        split, references, MatchResult(**fields), seconds=0.002, single=np.array([0.004, 0.008])
    )


def test_the_six_splits_get_means_and_one_threshold():
    sure = [outcome(name, [RIGHT] * 2, [0.9, 0.2]) for name in SIX[:5]]
    doubtful = outcome(SIX[5], [RIGHT, WRONG], [0.8, 0.5])
    other = outcome("csail.interleaved", [WRONG] * 9, [1.0] * 9)
    rows = table("all", [*sure, doubtful, other])
    assert [row["split"] for row in rows] == [*SIX, "csail.interleaved", "six"]
    six = rows[-1]
    assert six["mapped"] == 12
    assert six["top1"] == pytest.approx((5 + 0.5) / 6, abs=1e-4)
    # Above the wrong one's e_m are six right ones; each split by itself accepts them all.
    assert six["at_1%"] == pytest.approx(6 / 12)
    assert [row["at_1%"] for row in rows[:6]] == [1.0] * 5 + [0.5]
    assert [six[name] for name in ("correct", "false", "none")] == [6, 1, 5]
    assert (six["ms"], six["single_ms"], six["longest_ms"]) == (2.0, 6.0, 8.0)
    assert list(six) == list(rows[0])


def test_without_one_of_the_six_there_is_no_such_row():
    rows = table("5", [outcome(name, [RIGHT], [0.9]) for name in SIX[1:]])
    assert [row["split"] for row in rows] == list(SIX[1:])


def test_what_two_scans_saw_lies_on_the_same_walls():
    world = office(seed=3)
    poses = np.array([[12.0, 0.0, 0.3], [6.0, 0.2, 2.0]])
    scans = Scan.stack([scan_at(world, pose) for pose in poses])
    points = seen_points(scans, poses)
    assert len(points) == int(np.sum(scans.hit))
    assert max(clearance(world, xy) for xy in points) < 1e-3
