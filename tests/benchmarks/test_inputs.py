from typing import Any

import numpy as np
import pytest

from benchmarks.inputs import split, true_pairs
from benchmarks.workload import Skipped
from experiments.data import Split


def test_missing_data_skip_with_a_reason_that_helps(monkeypatch, tmp_path):
    monkeypatch.setenv("APRJAX_DATA", str(tmp_path))
    split.cache_clear()
    with pytest.raises(Skipped, match="APRJAX_DATA"):
        split("intel.interleaved")


def test_pairs_are_near_turned_little_and_of_mapped_queries():
    scans: Any = None
    references = np.array([[0, 0, 0], [0.1, 0, 3.0], [5, 0, 0]], float)
    queries = np.array([[0.2, 0, 0.1], [5.5, 0, 0], [0.3, 0, 0], [20, 0, 0]], float)
    mapped = np.array([True, True, False, True])
    found = list(true_pairs(Split("", scans, scans, references, queries, mapped), 2))
    assert [(reference, query) for reference, query, _ in found] == [(0, 0), (2, 1)]
    np.testing.assert_allclose([pose for *_, pose in found], [[0.2, 0, 0.1], [0.5, 0, 0]])
