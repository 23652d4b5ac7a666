import csv
import json

import numpy as np
import pytest

from aprjax.scan import Scan
from experiments import preselection
from experiments.data import Split
from tests.worlds import clearance, office, scan_at


@pytest.fixture(scope="module")
def split():
    """Ten references along a corridor, and a query half a metre from each."""
    world = office(seed=3)
    places = [np.array([2.0 + 2.0 * k, 0.0, 0.3 * (-1) ** k]) for k in range(10)]
    queries = [pose + np.array([0.4, 0.05, 0.1]) for pose in places]
    assert min(clearance(world, pose[:2]) for pose in queries) > 0.3
    stacked = [Scan.stack([scan_at(world, pose) for pose in each]) for each in (places, queries)]
    return Split("corridor", *stacked, np.array(places), np.array(queries), np.ones(10, bool))


def test_the_right_ones_come_last_among_equals_and_the_best_of_them_counts():
    scores = np.array([[3.0, 3.0, 1.0], [1.0, 2.0, 9.0], [0.0, 0.0, 0.0]])
    right = np.array([[True, False, False], [True, True, False], [False, False, True]])
    assert preselection.rank_of_right(scores, right).tolist() == [1, 1, 2]


def test_every_measure_is_written_and_votes_put_right_references_first(
    split, tmp_path, monkeypatch
):
    monkeypatch.setattr(preselection, "read_split", lambda name, every: split)
    monkeypatch.setattr(preselection, "SIZES", (5, 6))
    monkeypatch.setattr("sys.argv", ["preselection.py", "x", "--out", str(tmp_path), "--quick"])
    assert preselection.main() == 0
    with (tmp_path / "preselection.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = {(row["split"], row["references"], row["measure"]): row for row in rows}
    assert len(found) == 2 * 2 * 4
    for row in rows:
        assert 0 <= float(row["first_1"]) <= float(row["first_5"]) <= 1
        assert row["first_10"] == "1.0"  # no set has more
    assert found["corridor", "all", "c_m"]["queries"] == "10"
    assert float(found["corridor", "all", "votes"]["first_1"]) >= 0.8
    assert float(found["corridor", "all", "votes"]["first_5"]) == 1.0
    assert float(found["corridor", "all", "signature"]["first_5"]) >= 0.8
    assert (tmp_path / "preselection.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "configuration.json").read_text())["sizes"] == [6]
