import csv
import sys

import numpy as np

from aprjax.io.occupancy_grid import read_occupancy_grid
from experiments import occupancy_grid


def test_nine_in_ten_mapped_scans_of_a_real_run_are_found_in_the_grid_of_another(
    data, tmp_path, monkeypatch
):
    monkeypatch.setattr(sys, "argv", ["occupancy_grid.py", "--quick", "--out", str(tmp_path)])
    assert occupancy_grid.main() == 0
    with (tmp_path / "occupancy_grid.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["right"]) >= 0.90
    assert float(row["confident_wrong"]) <= 0.02
    assert read_occupancy_grid(tmp_path / "map.yaml").occupied.any()
    assert (tmp_path / "grid.png").read_bytes().startswith(b"\x89PNG")


def test_scans_are_mapped_within_two_metres_and_forty_degrees():
    poses = np.array([[0, 0, 0], [1.9, 0, np.radians(39)], [2.1, 0, 0], [0, 1, np.radians(-41)]])
    assert occupancy_grid.near_any(poses, np.zeros((1, 3))).tolist() == [True, True, False, False]
