import csv

import numpy as np

from experiments import million


def test_a_reference_counts_as_before_where_it_is_equal_and_not_right():
    ranking = million.Ranking(2)
    right = np.array([[True, False, False], [False, True, False]])
    same = np.array([[True, True, False], [True, True, False]])
    ranking.own(np.array([[0.5, 0.5, 0.9], [0.1, 0.6, 0.9]]), right, same)
    assert ranking.before.tolist() == [1, 0]
    ranking.others(np.array([[0.5, 0.5, 0.9], [0.1, 0.6, 0.9]]), same)
    assert ranking.before.tolist() == [2, 1]


def test_groups_are_divided_where_a_size_is_reached():
    parts = million._upto(iter([range(0, 20), range(20, 25)]), [1, 10, 100])
    assert [(part.start, part.stop) for part in parts] == [(0, 1), (1, 10), (10, 20), (20, 25)]


def test_floors_are_the_same_by_whichever_process():
    here = million.floors(range(2), 1)
    with million.makers() as pool:
        there = million.floors(range(2), 1, pool.map)
    np.testing.assert_array_equal(here.T_floor_ref, there.T_floor_ref)
    np.testing.assert_array_equal(here.references.ranges, there.references.ranges)
    assert here.queries is not None and there.queries is not None
    np.testing.assert_array_equal(here.queries.ranges, there.queries.ranges)


def test_signatures_find_more_right_references_than_q_m_among_a_thousand(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["million", "--out", str(tmp_path), "--quick"])
    assert million.main() == 0
    with (tmp_path / "recall.csv").open(newline="") as file:
        rows = {(row["references"], row["measure"]): row for row in csv.DictReader(file)}
    share = {key: float(row["first_64"]) for key, row in rows.items()}
    assert share["1000", "signature"] >= 0.9
    assert share["1000", "q_m"] <= 0.85
    assert (tmp_path / "recall.png").stat().st_size > 5000
    assert (tmp_path / "configuration.json").exists()
