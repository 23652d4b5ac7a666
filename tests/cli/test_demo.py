import csv
import io
from contextlib import redirect_stderr, redirect_stdout
from types import SimpleNamespace

import matplotlib.image
import numpy as np
import pytest

import aprjax.cli.demo as cli_demo
import aprjax.cli.lab as cli_lab
from aprjax.cli.main import main
from aprjax.result import MatchResult
from aprjax.scan import Scan
from tests.worlds import office, scan_at

SCANS = 40
PICTURES = ("map.png", "match.png")


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """A small demo: its folder, standard output and standard error."""
    folder = tmp_path_factory.mktemp("demo") / "new"
    size = ("--references", "5", "--scans", str(SCANS), "--resolution", "1")
    words = ("demo", "--out", str(folder), *size)
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        assert main(words) == 0
    return folder, out.getvalue(), err.getvalue()


def table_of(text):
    """The columns after the first of the Markdown table: lists of cells, the title first."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    labels, *columns = zip(*(rows[:1] + rows[2:]), strict=True)
    return labels, columns


def test_every_scan_is_counted_once_and_some_are_localized(demo):
    labels, columns = table_of(demo[1])
    assert labels[1:4] == ("correct", "false", "none")
    assert labels[0] == f"{SCANS} scans, 5 references"
    assert [column[0] for column in columns[:3]] == ["top 1", "top 5", "all references"]
    counts = np.array([column[1:4] for column in columns[:3]], int)
    assert counts.sum(axis=1).tolist() == [SCANS] * 3
    assert not counts[:, 1].any()
    assert counts[0, 0] <= counts[2, 0] >= SCANS // 5


def test_the_papers_numbers_stand_beside_it(demo):
    counts = np.array([column[1:4] for column in table_of(demo[1])[1][3:]], int)
    assert counts.tolist() == [[374, 0, 1031], [613, 1, 791], [831, 1, 573]]
    assert counts.sum(axis=1).tolist() == [1405] * 3


def test_the_times_are_of_one_scan(demo):
    for column in table_of(demo[1])[1][:3]:
        mean, maximum = (float(cell.removesuffix(" ms")) for cell in column[4:])
        assert 0.05 < mean <= maximum < 2000


def test_the_file_holds_the_printed_table(demo):
    with (demo[0] / "table.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    printed = [[cell.removesuffix(" ms") for cell in column] for column in table_of(demo[1])[1][:3]]
    assert rows[1:] == printed


def test_the_pictures_show_something(demo):
    assert {path.name for path in demo[0].iterdir()} == {*PICTURES, "table.csv"}
    for name in PICTURES:
        picture = matplotlib.image.imread(demo[0] / name)[..., :3]
        assert min(picture.shape[:2]) > 300
        assert 0.005 < np.mean(picture.min(axis=2) < 0.9) < 0.5


def test_messages_go_to_standard_error(demo):
    said = demo[2].splitlines()
    assert said[0].startswith(f"lab 0: 5 references, {SCANS} scans")
    assert said[1].startswith("compiled in ")
    assert said[-2:] == [str(demo[0] / name) for name in PICTURES]


# Without the engine: scans taken at the reference, and what a matcher might answer.


def answer(reference, pose, confident):
    return MatchResult(
        **dict.fromkeys(MatchResult.__dataclass_fields__)
        | {
            "reference": np.array([reference], np.int32),
            "T_ref_query": np.array([pose], np.float32),
            "quality": np.array([0.7], np.float32),
            "valid": np.array([True]),
            "confident": np.bool_(confident),
        }
    )  # type: ignore


ANSWERS = [
    answer(0, (0.0, 0.0, 0.0), True),
    answer(0, (0.45, 0.0, 0.1), True),
    answer(0, (0.55, 0.0, 0.0), True),
    answer(0, (0.0, 0.0, 0.2), True),
    answer(0, (0.0, 0.0, 0.0), False),
    answer(0, (3.0, 0.0, 0.0), False),
]


@pytest.fixture
def fake(monkeypatch):
    """A lab of seven references and six scans at one place, and a matcher that knows nothing."""
    here, segments = np.array([12.0, 0.0, 0.3]), office(3)

    def run(count):
        scans = Scan.stack([scan_at(segments, here)] * count)
        return SimpleNamespace(
            scans=scans, T_world_laser=np.tile(here, (count, 1)), stamps=np.zeros(count)
        )

    lab = SimpleNamespace(references=run(7), queries=run(6))
    calls = []

    def match(scan, references, config):
        calls.append((len(references), config.top_k))
        return ANSWERS[(len(calls) - 4) % len(ANSWERS)]

    monkeypatch.setattr(cli_demo, "build_lab", lambda arguments: lab)
    monkeypatch.setattr(cli_demo, "match", match)
    return calls


def test_an_answer_is_right_within_half_a_metre_and_ten_degrees_and_none_unless_confident(
    fake, command, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    status, out, _ = command("demo")
    assert status == 0
    assert [column[1:4] for column in table_of(out)[1][:3]] == [("2", "2", "2")] * 3
    assert not list(tmp_path.iterdir())


def test_compilation_comes_first_and_then_every_scan_by_itself(fake, command):
    command("demo")
    assert fake[:3] == [(7, 1), (7, 5), (7, None)]
    assert fake[3:] == [(7, top_k) for top_k in (1, 5, None) for _ in range(6)]


def forbid_simulating(monkeypatch):
    def never(*arguments):
        raise AssertionError("the simulation was started")

    monkeypatch.setattr(cli_lab, "lab", never)


@pytest.mark.parametrize(
    "words",
    [
        ["--out"],
        ["--seed", "x"],
        ["--references", "0"],
        ["--scans", "-3"],
        ["--laser", "none"],
        ["more"],
    ],
)
def test_bad_usage(command, monkeypatch, words):
    forbid_simulating(monkeypatch)
    status, out, err = command("demo", *words)
    assert (status, out) == (2, "")
    assert err.startswith("usage: aprjax")
    assert err.splitlines()[-1].startswith("aprjax")


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_a_folder_that_cannot_be_written_is_found_before_simulating(
    command, monkeypatch, tmp_path, place
):
    forbid_simulating(monkeypatch)
    (tmp_path / "file").write_text("")
    status, out, err = command("demo", "--out", tmp_path / place)
    assert (status, out) == (1, "")
    assert err.startswith(f"aprjax: {tmp_path / place}: cannot be written: ")
    assert err.count("\n") == 1


def test_help(command):
    status, out, _ = command("demo", "--help")
    assert status == 0
    assert out.startswith("usage: aprjax demo")
