import csv
from typing import Any

import numpy as np
import pytest

from aprjax.io.tables import write_matches


def results(**changes: Any) -> dict[str, Any]:
    """Three queries with up to two hypotheses: two, none, and only the second slot."""
    arrays = {
        "reference": np.array([[4, 7], [0, 0], [9, 2]], np.int32),
        "pose": np.arange(18, dtype=np.float32).reshape(3, 2, 3) / 10,
        "quality": np.array([[0.9, 0.8], [0, 0], [np.nan, 0.7]], np.float32),
        "preselection": np.full((3, 2), 1 / 3, np.float32),
        "valid": np.array([[True, True], [False, False], [False, True]]),
        "status": ["ok", "no_candidate", "ambiguous"],
        "agreeing_anchors": np.array([[5, 4], [0, 0], [0, 3]]),
        "agreeing_beams": np.array([[100, 90], [0, 0], [0, 80]]),
        "probability": np.array([[1.0, 0.99], [0, 0], [np.nan, 0.5]], np.float32),
    }
    return arrays | changes


def read(path):
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_one_row_per_valid_hypothesis_and_one_for_a_query_without(tmp_path):
    write_matches(tmp_path / "m.csv", **results())
    assert (tmp_path / "m.csv").read_text() == (
        "query,rank,reference,x,y,theta,quality,preselection,status,anchors,beams,probability\n"
        "0,0,4,0.0,0.1,0.2,0.9,0.33333334,ok,5,100,1.0\n"
        "0,1,7,0.3,0.4,0.5,0.8,0.33333334,ok,4,90,0.99\n"
        "1,0,,,,,,,no_candidate,,,\n"
        "2,0,2,1.5,1.6,1.7,0.7,0.33333334,ambiguous,3,80,0.5\n"
    )


def test_numbers_read_back_as_the_same_float32(tmp_path):
    pose = np.random.default_rng(0).normal(0, 20, (3, 2, 3)).astype(np.float32)
    pose[0, 0] = 1e-30, -3e7, np.pi
    write_matches(tmp_path / "m.csv", **results(pose=pose))
    rows = [row for row in read(tmp_path / "m.csv")[1:] if row[2]]
    got = np.array([row[3:6] for row in rows], np.float32)
    np.testing.assert_array_equal(got, pose[results()["valid"]])


def test_no_query_and_no_slot_are_tables_too(tmp_path):
    empty: dict[str, Any] = {name: np.asarray(value)[:0] for name, value in results().items()}
    write_matches(tmp_path / "m.csv", **empty)
    assert len(read(tmp_path / "m.csv")) == 1
    no_slot = {name: value[:, :0] for name, value in results().items() if name != "status"}
    write_matches(tmp_path / "m.csv", **no_slot, status=["ok"] * 3)
    assert [row[2] for row in read(tmp_path / "m.csv")] == ["reference", "", "", ""]


@pytest.mark.parametrize("name", [name for name in results() if name != "valid"])
def test_a_shape_that_does_not_fit_is_named_and_nothing_written(tmp_path, name):
    with pytest.raises(ValueError, match=name):
        write_matches(tmp_path / "m.csv", **results(**{name: results()[name][:2]}))
    assert not list(tmp_path.iterdir())
