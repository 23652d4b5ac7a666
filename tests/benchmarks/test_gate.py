import dataclasses

import pytest

from benchmarks.gate import Baseline, BaselineError, complaints, read_baseline, write_baseline
from benchmarks.workload import Figure

FIGURE = Figure("batch.x", "median", "µs", 10.0, 9.0, 11.0, 7, slowness=1.0, tolerance=0.2)
BASELINE = Baseline("some machine", "cpu", (FIGURE,))


def judged(*figures: Figure, selected=("batch.x",), platform="cpu") -> list[str]:
    return complaints(list(figures), BASELINE, set(selected), platform)


@pytest.mark.parametrize(("value", "passes"), [(5.0, True), (11.9, True), (12.1, False)])
def test_the_tolerance_decides(value, passes):
    lines = judged(dataclasses.replace(FIGURE, value=value))
    assert (lines == []) == passes
    assert all("batch.x median" in line for line in lines)


def test_a_slow_machine_is_not_blamed_on_the_program():
    slow = dataclasses.replace(FIGURE, value=30.0, slowness=3.0)
    assert judged(slow) == []
    assert judged(dataclasses.replace(slow, slowness=2.0))


def test_a_fast_machine_hides_no_slower_program():
    assert judged(dataclasses.replace(FIGURE, value=10.0, slowness=0.5))


def test_the_tolerance_is_that_of_the_workload_now_not_of_the_baseline():
    assert judged(dataclasses.replace(FIGURE, value=11.0, tolerance=0.05))


def test_what_is_not_a_number_does_not_pass():
    assert judged(dataclasses.replace(FIGURE, value=float("nan")))


def test_a_figure_without_a_baseline_passes():
    assert judged(FIGURE, dataclasses.replace(FIGURE, metric="99th percentile", value=99.0)) == []


def test_a_selected_workload_that_was_not_measured_fails():
    assert judged() == ["batch.x median: not measured"]


def test_a_workload_that_was_not_selected_is_not_missed_but_nothing_to_compare_fails():
    both = Baseline("", "cpu", (FIGURE, dataclasses.replace(FIGURE, workload="other")))
    assert complaints([FIGURE], both, {"batch.x"}, "cpu") == []
    (line,) = complaints([FIGURE], BASELINE, {"other"}, "cpu")
    assert "none of the selected" in line


def test_units_that_differ_are_not_compared():
    (line,) = judged(dataclasses.replace(FIGURE, unit="ms"))
    assert "batch.x median" in line


def test_another_kind_of_device_is_not_compared():
    (line,) = judged(FIGURE, platform="gpu")
    assert "cpu" in line
    assert "gpu" in line


def test_a_baseline_is_read_as_it_was_written(tmp_path):
    write_baseline(BASELINE, tmp_path / "baseline.json")
    assert read_baseline(tmp_path / "baseline.json") == BASELINE


@pytest.mark.parametrize("content", ["", "[]", '{"machine": "", "platform": "cpu"}', "\x00"])
def test_another_file_is_refused_in_one_line_that_names_it(tmp_path, content):
    path = tmp_path / "other.json"
    path.write_text(content)
    with pytest.raises(BaselineError, match=r"other\.json") as error:
        read_baseline(path)
    assert "\n" not in str(error.value)


def test_a_missing_baseline_is_named(tmp_path):
    with pytest.raises(BaselineError, match="nowhere"):
        read_baseline(tmp_path / "nowhere.json")
