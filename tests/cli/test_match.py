import csv
import gzip
import io
import sys
from pathlib import Path

import numpy as np
import pytest

import aprjax.batch
import aprjax.cli.match as cli_match
from aprjax.cli.main import main
from aprjax.grid.drawing import grid_from_scans
from aprjax.io.logs import read_log
from aprjax.io.occupancy_grid import write_occupancy_grid
from aprjax.io.tables import MATCH_COLUMNS
from aprjax.io.trajectory import read_tum
from aprjax.metrics import deviations


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def lines_of(path):
    return gzip.decompress(path.read_bytes()).decode().splitlines(keepends=True)


def write(path, lines):
    path.write_bytes("".join(lines).encode())
    return path


@pytest.fixture(scope="module")
def table(logs, tmp_path_factory):
    """The table of the two logs, as text."""
    out = tmp_path_factory.mktemp("table") / "matches.csv"
    assert main(["match", *map(str, logs), "--out", str(out)]) == 0
    return out.read_text()


def test_the_table_has_the_columns_and_rows_that_were_promised(table):
    assert table.splitlines()[0] == ",".join(MATCH_COLUMNS)
    rows = rows_of(table)
    assert [int(row["query"]) for row in rows] == sorted(int(row["query"]) for row in rows)
    assert {int(row["query"]) for row in rows} == set(range(20))
    for query in range(20):
        mine = [row for row in rows if int(row["query"]) == query]
        assert [int(row["rank"]) for row in mine] == list(range(len(mine)))
        found = [row for row in mine if row["reference"]]
        assert len(found) in (0, len(mine))
        assert len(mine) <= 5
        qualities = [float(row["quality"]) for row in found]
        assert qualities == sorted(qualities, reverse=True)
        assert all(0 <= int(row["reference"]) < 8 for row in found)


def test_most_queries_are_matched_with_the_reference_they_were_taken_near(table):
    best = [row for row in rows_of(table) if row["rank"] == "0"]
    right = [row["reference"] == str(int(row["query"]) % 8) for row in best]
    assert sum(right) >= 14


def test_scans_are_found_in_an_occupancy_grid_and_written_as_a_trajectory(logs, tmp_path, command):
    known, seen = (list(read_log(path)) for path in logs)
    grid = grid_from_scans(
        [entry.scan for entry in (*known, *seen)],
        np.array([entry.logged_pose for entry in (*known, *seen)]),
    )
    write_occupancy_grid(grid, tmp_path / "office.yaml")
    tum = tmp_path / "found.tum"
    words = ("match", tmp_path / "office.yaml", logs[1], "--out", tmp_path / "m.csv", "--tum", tum)
    assert command(*words)[0] == 0
    stamps, poses = read_tum(tum)
    truth = {round(entry.stamp, 3): entry.logged_pose for entry in seen}
    gap, turn = deviations(poses, np.array([truth[round(stamp, 3)] for stamp in stamps]))
    assert len(stamps) >= 8
    assert np.all((gap < 0.2) & (turn < np.radians(5)))


def test_without_poses_of_the_references_there_is_no_trajectory(logs, tmp_path, command):
    tum = tmp_path / "found.tum"
    status, _, err = command("match", *logs, "--out", tmp_path / "m.csv", "--tum", tum)
    assert (status, err.count("\n")) == (1, 1)
    assert "references.log.gz: states no poses" in err
    assert not tum.exists()


def test_a_grid_that_is_none_is_one_line(logs, tmp_path, command):
    (tmp_path / "office.yaml").write_text("image: none.pgm\n")
    words = ("match", tmp_path / "office.yaml", logs[1], "--out", tmp_path / "m.csv")
    status, _, err = command(*words)
    assert (status, err.count("\n")) == (1, 1)
    assert "office.yaml: resolution is missing" in err


def test_one_line_sums_up(logs, table, tmp_path, command):
    status, out, err = command("match", *logs, "--out", tmp_path / "m.csv")
    assert (status, out) == (0, "")
    assert err.count("\n") == 1
    assert err.startswith("20 queries, 8 references: ")
    assert "ms per query" in err
    assert "ok " in err
    assert (tmp_path / "m.csv").read_text() == table


def test_standard_output(logs, table, command):
    status, out, _ = command("match", *logs, "--out", "-")
    assert status == 0
    assert out == table


def test_poses_are_never_looked_at(logs, table, tmp_path, command):
    blind = []
    for path in logs:
        lines = [line.split() for line in lines_of(path)]
        for words in lines:
            count = int(words[8])
            words[10 + count : 16 + count] = ["0"] * 6
        blind.append(write(tmp_path / path.stem, [" ".join(words) + "\n" for words in lines]))
    assert command("match", *blind, "--out", "-")[1] == table


def test_shuffled_queries_are_only_renumbered(logs, table, tmp_path, command):
    lines = lines_of(logs[1])
    order = np.random.default_rng(0).permutation(len(lines))
    shuffled = write(tmp_path / "shuffled.log", [lines[i] for i in order])
    rows = rows_of(command("match", logs[0], shuffled, "--out", "-")[1])
    for row in rows:
        row["query"] = str(order[int(row["query"])])
    rows.sort(key=lambda row: (int(row["query"]), int(row["rank"])))
    assert_same_values(rows, rows_of(table))


def assert_same_values(rows, expected):
    assert len(rows) == len(expected)
    numbers = {"x", "y", "theta", "quality", "preselection", "probability"}
    for row, want in zip(rows, expected, strict=True):
        for name, value in row.items():
            if name in numbers and value:
                assert float(value) == pytest.approx(
                    float(want[name]), abs=2e-3 if name == "probability" else 1e-4
                )
            else:
                assert value == want[name]


def test_pieces_change_nothing(logs, table, tmp_path, command, monkeypatch):
    # 17, 17 and 16 queries: a piece of 17 compiles to the same shape as the table's 20.
    monkeypatch.setattr(cli_match, "_PIECES", (20,))
    lines = lines_of(logs[1])
    longer = write(tmp_path / "longer.log", [*lines, *lines, *lines[:10]])
    status, out, err = command("match", logs[0], longer, "--out", "-")
    assert status == 0
    assert err.startswith("50 queries")
    assert "compilation" not in err
    rows, expected = rows_of(out), []
    for repeat in range(3):
        for row in rows_of(table):
            query = int(row["query"]) + 20 * repeat
            if query < 50:
                expected.append(row | {"query": str(query)})
    assert_same_values(rows, expected)


def test_saved_references_give_the_same_table(logs, table, tmp_path, command):
    saved = tmp_path / "references.npz"
    status, _, _ = command("match", *logs, "--out", "-", "--save-references", saved)
    assert status == 0
    status, out, _ = command("match", saved, logs[1], "--out", "-")
    assert (status, out) == (0, table)

    status, out, _ = command("match", saved, logs[1], "--out", "-", "--anchors", 16)
    assert (status, out) == (0, table)
    status, out, err = command("match", saved, logs[1], "--out", "-", "--anchors", 20)
    assert (status, out) == (1, "")
    assert err == f"aprjax: {saved}: was saved with 16 anchors, not 20\n"


def test_options_arrive_in_the_configuration(logs, command, monkeypatch):
    seen, real = [], aprjax.batch.match_batch

    def spy(scans, references, config, **_):
        seen.append((config, references.config))
        return real(scans, references)

    monkeypatch.setattr(cli_match, "match_batch", spy)
    options = ("--top-k", 3, "--hypotheses", 2, "--min-quality", 0.25, "--no-cascade")
    assert command("match", *logs, "--out", "-", *options)[0] == 0
    config = seen[-1][0]
    assert (config.top_k, config.hypotheses, config.cascade) == (3, 2, False)
    assert float(config.min_quality) == 0.25
    command("match", *logs, "--out", "-", "--top-k", "all", "--hypotheses", 60)
    config = seen[-1][0]
    assert (config.top_k, config.hypotheses) == (None, 60)
    assert config.listing.kept >= 60


def test_damaged_lines_are_counted_and_the_first_shown(logs, table, tmp_path, command):
    lines = lines_of(logs[1])
    damaged = write(tmp_path / "damaged.log", ["ROBOTLASER1 0 1\n"] * 5 + lines)
    status, out, err = command("match", logs[0], damaged, "--out", "-")
    assert (status, out) == (0, table)
    said = err.splitlines()
    assert said[0] == f"{damaged}: skipped 5 damaged lines"
    assert [line.split(":")[0] for line in said[1:4]] == ["  line 1", "  line 2", "  line 3"]
    assert len(said) == 5

    status, out, err = command("match", logs[0], damaged, "--out", "-", "--strict")
    assert (status, out) == (1, "")
    assert err.startswith(f"aprjax: {damaged}: line 1: ")
    assert err.count("\n") == 1


def bad_files(folder, good):
    """Files that are no logs, by what is wrong with them."""
    files = {name: folder / name for name in ("missing", "empty", "text", "cut.gz", "no-scans")}
    files["empty"].write_bytes(b"")
    files["text"].write_text("To be or not to be\n" * 5)
    files["cut.gz"].write_bytes(good.read_bytes()[:-2000])
    files["no-scans"].write_text("ODOM 0 0 0 0 0 0 0 host 0\n")
    files["cut.npz"] = folder / "cut.npz"
    files["cut.npz"].write_bytes(b"PK\x03\x04abc")
    files["directory"] = folder
    return files


@pytest.mark.parametrize(
    "wrong", ["missing", "empty", "text", "cut.gz", "no-scans", "cut.npz", "directory"]
)
@pytest.mark.parametrize("place", [0, 1])
def test_bad_data_is_one_line(logs, tmp_path, command, monkeypatch, wrong, place):
    forbid_matching(monkeypatch)
    inputs = list(logs)
    inputs[place] = bad_files(tmp_path, logs[1])[wrong]
    out = tmp_path / "out.csv"
    status, printed, err = command("match", *inputs, "--out", out)
    assert (status, printed) == (1, "")
    assert err.startswith(f"aprjax: {inputs[place]}: ")
    assert err.count("\n") == 1
    assert not out.exists()


def forbid_matching(monkeypatch):
    def never(*arguments, **options):
        raise AssertionError("the long computation was started")

    monkeypatch.setattr(cli_match, "match_batch", never)


@pytest.mark.parametrize("option", ["--out", "--save-references"])
@pytest.mark.parametrize("place", ["", "absent/out.csv", "file/out.csv", "x" * 300 + ".csv"])
def test_places_that_cannot_be_written_are_found_before_matching(
    logs, tmp_path, command, monkeypatch, option, place
):
    forbid_matching(monkeypatch)
    (tmp_path / "file").write_text("")
    words = {"--out": "-"} | {option: tmp_path / place}
    status, printed, err = command("match", *logs, *(w for pair in words.items() for w in pair))
    assert (status, printed) == (1, "")
    assert err.startswith(f"aprjax: {tmp_path / place}: ")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_inputs_are_not_overwritten(logs, command, monkeypatch):
    forbid_matching(monkeypatch)
    before = [path.read_bytes() for path in logs]
    for path in logs:
        status, _, err = command("match", *logs, "--out", path)
        assert status == 1
        assert err == f"aprjax: {path}: would overwrite what is read\n"
    assert [path.read_bytes() for path in logs] == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_one_line(logs, command):
    status, _, err = command("match", *logs, "--out", "/dev/full")
    assert (status, err) == (1, "aprjax: /dev/full: No space left on device\n")


@pytest.mark.usefixtures("table", "full_disk")
@pytest.mark.parametrize("option", ["--out", "--save-references"])
def test_a_disk_that_becomes_full_is_one_line_and_leaves_no_half_file(
    logs, tmp_path, command, option
):
    words = {"--out": "-"} | {option: tmp_path / "file"}
    status, _, err = command("match", *logs, *(word for pair in words.items() for word in pair))
    assert status == 1
    assert err.startswith(f"aprjax: {tmp_path / 'file'}")
    assert err.endswith(": File too large\n")
    assert err.count("\n") == 1
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_interruption_is_one_line(logs, tmp_path, command, monkeypatch):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli_match, "match_batch", interrupt)
    status, _, err = command("match", *logs, "--out", tmp_path / "m.csv")
    assert (status, err) == (130, "aprjax: interrupted\n")
    assert not list(tmp_path.iterdir())


def test_two_outputs_that_are_one_file_are_one_clear_line(logs, tmp_path, command):
    both = tmp_path / "both"
    status, _, err = command("match", *logs, "--out", both, "--save-references", both)
    assert (status, err) == (1, f"aprjax: {both}: would be written twice\n")
    assert not both.exists()


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["match"],
        ["match", "a", "b"],
        ["dance"],
        ["match", "a", "b", "--out", "-", "--top-k", "0"],
        ["match", "a", "b", "--out", "-", "--top-k", "some"],
        ["match", "a", "b", "--out", "-", "--hypotheses", "-1"],
        ["match", "a", "b", "--out", "-", "--hypotheses", "1.5"],
        ["match", "a", "b", "--out", "-", "--min-quality", "nan"],
        ["match", "a", "b", "--out", "-", "--min-quality", "2"],
        *(["match", "a", "b", "--out", "-", "--anchors", n] for n in ("0", "1", "129", "9" * 30)),
        *(["match", "a", "b", "--out", "-", "--hypotheses", n] for n in ("1001", "9" * 30)),
        ["info"],
    ],
)
def test_bad_usage(command, words):
    status, out, err = command(*words)
    assert (status, out) == (2, "")
    assert err.startswith("usage: aprjax")


@pytest.mark.parametrize("words", [["--help"], ["match", "--help"], ["info", "--help"]])
def test_help(command, words):
    status, out, err = command(*words)
    assert (status, err) == (0, "")
    assert out.startswith("usage: aprjax")


def test_the_progress_of_a_terminal_ends_its_line_before_an_error(
    logs, command, capsys, monkeypatch
):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli_match, "match_batch", interrupt)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    _, _, err = command("match", *logs, "--out", "-")
    assert err.startswith("\rmatching [....")
    assert err.endswith("\naprjax: interrupted\n")
