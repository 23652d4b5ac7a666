import csv

import pytest

from experiments import worked_example


def test_the_example_goes_as_the_papers_text_says(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["worked_example.py", "--out", str(tmp_path), "--quick"])
    assert worked_example.main() == 0
    with (tmp_path / "worked_example.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["line"], row["column"], row["maximum"], row["wrong"]) == ("2", "3", "3", "2")
    assert float(row["rotation_deg"]) == pytest.approx(30, abs=3)
    assert (row["maximum_in_peak"], row["wrong_in_peak"]) == ("2", "0")
    assert float(row["error_m"]) < 1e-3
    with (tmp_path / "correspondences.csv").open(newline="") as file:
        pairs = list(csv.DictReader(file))
    assert [pair["rotation_deg"] for pair in pairs if pair["same_edge"] == "False"] == ["-45.0"]
    assert len(pairs) == 4
    written = {path.name for path in tmp_path.iterdir()}
    assert written >= {"worked_example.png", "configuration.json"}
