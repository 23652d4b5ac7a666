import dataclasses
import json

import numpy as np
import pytest

from benchmarks import __main__ as program
from benchmarks.gate import Baseline, write_baseline
from benchmarks.machine import Probe
from benchmarks.workload import Metric, Samples, Skipped, Workload


def missing(quick):
    raise Skipped("no data")


def broken(quick):
    raise RuntimeError("it broke")


MEDIAN = (Metric("median", 0.5, 0.1),)
QUICK = Workload(
    "some.quick", "", "ms", MEDIAN, lambda quick: Samples(np.arange(3 if quick else 5))
)
BOTH = Workload(
    "some.both",
    "",
    "s",
    (*MEDIAN, Metric("99th percentile", 0.99, 0.1)),
    lambda quick: Samples(np.arange(101.0), "a note"),
    cores="all",
)
MISSING = Workload("missing", "", "ms", MEDIAN, missing)
BROKEN = Workload("broken", "", "ms", MEDIAN, broken)


@pytest.fixture(autouse=True)
def _machine(monkeypatch, tmp_path):
    """One core of it takes twice as long as the nominal one, both together four times."""
    monkeypatch.setattr(program, "probe", lambda: Probe(0.020, 0.020, 0.020))
    monkeypatch.setattr(program, "BASELINE", tmp_path / "baseline.json")
    monkeypatch.setattr(program, "WORKLOADS", (QUICK, BOTH))


def table(folder) -> str:
    return (folder / "benchmarks.csv").read_text()


def test_table_and_plot_hold_all_metrics_with_spread_and_normalised(tmp_path):
    assert program.main(["--out", str(tmp_path / "out")]) == 0
    lines = table(tmp_path / "out").splitlines()
    assert lines[1].startswith("some.quick,median,ms,lower,2.0,0.4,3.6,5,1.0,2.0,0.1,")
    assert lines[2].startswith("some.both,median,s,lower,50.0,10.0,90.0,101,12.5,4.0,0.1,a note")
    assert lines[3].startswith("some.both,99th percentile,s,lower,99.0,10.0,90.0,101,24.75,4.0,")
    assert (tmp_path / "out" / "benchmarks.png").read_bytes().startswith(b"\x89PNG")
    assert "some.both" in (tmp_path / "out" / "benchmarks.txt").read_text()


def test_names_and_wildcards_select(capsys):
    assert program.main(["*.quick", "--quick"]) == 0
    shown = capsys.readouterr().out
    assert "some.quick" in shown
    assert "some.both" not in shown


def test_a_list_measures_nothing(monkeypatch, capsys):
    monkeypatch.setattr(program, "WORKLOADS", (BROKEN,))
    assert program.main(["--list"]) == 0
    assert "broken" in capsys.readouterr().out


def test_an_unknown_name_is_a_usage_error(capsys):
    with pytest.raises(SystemExit) as error:
        program.main(["nonsense"])
    assert error.value.code == 2
    assert "nonsense" in capsys.readouterr().err


def test_missing_data_skip_with_the_reason_and_a_failure_is_told(monkeypatch, capsys):
    monkeypatch.setattr(program, "WORKLOADS", (MISSING, QUICK))
    assert program.main([]) == 0
    assert "missing: skipped: no data" in capsys.readouterr().out
    monkeypatch.setattr(program, "WORKLOADS", (BROKEN, QUICK))
    assert program.main([]) == 1
    shown = capsys.readouterr().out
    assert "broken: failed: it broke" in shown
    assert "some.quick" in shown


def test_no_baseline_of_a_part_is_written(monkeypatch, tmp_path):
    with pytest.raises(SystemExit):
        program.main(["some.quick", "--write-baseline"])
    monkeypatch.setattr(program, "WORKLOADS", (MISSING, QUICK))
    assert program.main(["--write-baseline"]) == 1
    assert not (tmp_path / "baseline.json").exists()


def test_a_run_passes_its_own_baseline_and_fails_a_faster_one_by_name(tmp_path, capsys):
    own = tmp_path / "baseline.json"
    assert program.main(["--write-baseline"]) == 0
    assert program.main(["--gate", str(own)]) == 0
    values = json.loads(own.read_text())
    assert [figure["workload"] for figure in values["figures"]] == ["some.quick"] + 2 * [
        "some.both"
    ]
    values["figures"][0]["value"] /= 2
    own.write_text(json.dumps(values))
    capsys.readouterr()
    assert program.main(["--gate", str(own)]) == 1
    assert "gate: some.quick median" in capsys.readouterr().err


def test_a_baseline_that_cannot_be_read_is_a_usage_error(tmp_path, capsys):
    assert program.main(["--gate", str(tmp_path / "none.json")]) == 2
    assert "none.json" in capsys.readouterr().err


def test_a_gate_judges_only_what_was_selected(tmp_path, monkeypatch):
    measured, *_ = program.measure([QUICK, BOTH], quick=False)
    fast = [dataclasses.replace(figure, value=1e-9) for figure in measured]
    write_baseline(
        Baseline("", program.jax.default_backend(), (measured[0], *fast[1:])), tmp_path / "b"
    )
    assert program.main(["some.quick", "--gate", str(tmp_path / "b")]) == 0
    assert program.main(["some.both", "--gate", str(tmp_path / "b")]) == 1
