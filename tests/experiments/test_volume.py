import csv
import json

import numpy as np
import pytest

from aprjax.plane import compose
from experiments import volume
from experiments.volume import PAPER, Growth, Tracked, held, is_anew, longest_growth, summed
from tests.tracking.worlds import SPACING, at, drive, sure


def test_volumes_hold_the_truth_grow_by_odometry_and_shrink_where_apr_confirms(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("sys.argv", ["volume.py", "--quick", "--out", str(tmp_path)])
    assert volume.main() == 0
    with (tmp_path / "volume.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    figures = {name: float(value) for name, value in row.items() if name != "sources"}
    assert figures["inside"] >= 0.93
    assert figures["inside"] >= figures["claimed"]
    assert figures["nearest_outside_m"] > 4.0  # another place, and never the margin of a volume
    assert 0.5 <= figures["confirmed_radius_m"] <= 0.6
    assert figures["confirmed_off_m"] <= 0.05
    assert figures["long_radius_m"] >= 1.5
    assert figures["long_angle_deg"] >= 30.0
    assert figures["long_inside"] >= 0.95
    with (tmp_path / "hypotheses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert 300 <= len(rows) == figures["cycles"] <= volume.CYCLES
    for name in ("volume.png", "claims.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "configuration.json").read_text())["cycles"] == volume.CYCLES


@pytest.fixture
def told():
    """Confirmed at node 0, driven 3 m in steps of one unconfirmed, and confirmed at node 1; the
    truth is 0.1 m to the left of where the centre is."""
    made = sure()
    beliefs, confirmed = [made.belief], [True]
    for metres in (1.0, 2.0, 3.0, 4.0):
        moved = made.move(step=drive(1.0, deviation=0.2))
        seen = [at(1, 0.0, probability=0.99)] if metres == SPACING else []
        beliefs.append(made.observe(estimates=seen))
        confirmed.append(is_anew(moved, beliefs[-1]))
    T_world_node = np.array([[5.0, 5.0, np.pi / 2], [5.0, 9.0, np.pi / 2], [5.0, 13.0, np.pi / 2]])
    truth = [compose(T_world_node[0], np.array([x, 0.1, 0.0])) for x in range(5)]
    return Tracked(made.world, T_world_node, np.array(truth), {PAPER: beliefs}, {PAPER: confirmed})


def test_a_hypothesis_is_anew_where_an_estimate_made_its_volume(told):
    assert told.confirmed[PAPER] == [True, False, False, False, True]
    assert not is_anew(told.beliefs[PAPER][0], told.beliefs[PAPER][0])


def test_the_truth_is_compared_in_the_frame_of_the_home_node(told):
    rows = held(told, PAPER, seed=0)
    assert [row["node"] for row in rows] == [0, 0, 0, 0, 1]
    assert [row["off_m"] for row in rows] == [0.1] * 5
    assert [row["unconfirmed_m"] for row in rows] == [0.0, 1.0, 2.0, 3.0, 0.0]
    assert all(row["inside"] for row in rows)
    row = summed(PAPER, {column: np.array([row[column] for row in rows]) for column in rows[0]})
    assert (row["inside"], row["nearest_outside_m"]) == (1.0, "")
    assert row["long_radius_m"] > row["confirmed_radius_m"]


def test_the_truth_outside_of_either_size_is_outside(told):
    told.T_world_laser[1] += [3.0, 0.0, 0.0]
    told.T_world_laser[2] += [0.0, 0.0, np.radians(60)]
    assert [row["inside"] for row in held(told, PAPER, 0)] == [True, False, False, True, True]


def test_growth_ends_where_the_same_hypothesis_is_confirmed(told):
    beliefs, confirmed = told.beliefs[PAPER], told.confirmed[PAPER]
    assert longest_growth(beliefs, confirmed) == Growth(first=0, again=4)
    with pytest.raises(ValueError, match="confirmed again"):
        longest_growth(beliefs[:4], confirmed[:4])
