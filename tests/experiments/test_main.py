"""`python -m experiments`, with experiments that take no time."""

import csv
import json

import pytest

import experiments.__main__ as program
from experiments.__main__ import EXPERIMENTS, ROOT, Experiment

WRITES = "import sys; open(sys.argv[2] + '/t.csv', 'w'); print('done')"
GOOD = Experiment("writes", command=("-c", WRITES))
BAD = Experiment("fails", command=("-c", "import sys; sys.exit('no data')"))


@pytest.fixture
def two(monkeypatch):
    monkeypatch.setattr(program, "EXPERIMENTS", {"bad": BAD, "good": GOOD})


def test_one_that_fails_is_named_and_the_others_run(two, tmp_path, capsys):
    assert program.main(["--out", str(tmp_path), "--quick"]) == 1
    assert "bad: failed" in capsys.readouterr().err
    assert (tmp_path / "bad" / "output.txt").read_text() == "no data\n"
    assert (tmp_path / "good" / "output.txt").read_text() == "done\n"
    found = json.loads((tmp_path / "manifest.json").read_text())
    assert found["quick"] is True
    assert {name: each["status"] for name, each in found["experiments"].items()} == {
        "bad": 1,
        "good": 0,
    }
    assert found["experiments"]["good"]["files"] == ["output.txt", "t.csv"]
    assert found["experiments"]["good"]["command"][-3:] == ["--out", "good", "--quick"]
    with (tmp_path / "times.csv").open(newline="") as file:
        assert [row["experiment"] for row in csv.DictReader(file)] == ["bad", "good"]


def test_only_what_is_named_runs(two, tmp_path):
    assert program.main(["good", "--out", str(tmp_path)]) == 0
    assert not (tmp_path / "bad").exists()


@pytest.mark.parametrize("words", [["nonsense", "--out", "x"], []])
def test_bad_usage(two, words):
    with pytest.raises(SystemExit) as stop:
        program.main(words)
    assert stop.value.code == 2


def test_every_script_with_a_command_line_is_an_experiment():
    scripts = {
        path.stem
        for path in (ROOT / "experiments").glob("[a-z]*.py")
        if '__name__ == "__main__"' in path.read_text()
    }
    assert scripts == {name for name, each in EXPERIMENTS.items() if each.command is None}
