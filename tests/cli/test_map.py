import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place
from aprjax.world.store import save_map
from tests.world.rings import drive, mapped

SURE = np.diag([1e-3, 1e-3, 1e-4])


@pytest.fixture(scope="module")
def log():
    """A log of a drive round a ring."""
    return mapped()[0]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A map file of a triangle of nodes that is torn, one node apart, and one reference."""
    world = WorldModel()
    for node in range(4):
        world.add_node(node)
        world.place_scan(node, Place(node, np.zeros(3)))
    corner = np.array([3.0, 0.0, 2 * np.pi / 3])
    world.add_arc(Arc(0, 1, corner, SURE, "driven"))
    world.add_arc(Arc(1, 2, corner, SURE, "driven"))
    world.add_arc(Arc(2, 0, corner + np.array([0.4, 0, 0]), SURE, "closed"))
    scan = drive(seed=3, way=0.5)[0][0].scan
    world.add_references([scan], [Appearance(Place(1, np.array([0.2, 0.0, 0.1])), 1)])
    path = tmp_path_factory.mktemp("maps") / "small.map"
    save_map(world, path)
    return path


def test_a_log_becomes_a_map_that_can_be_described_and_scored(command, tmp_path):
    _, path, truth = mapped()
    facts = json.loads(command("map", "info", path, "--json")[1])
    assert facts["scans_placed"] == len(truth)
    assert facts["arcs"] == facts["nodes"]
    assert (facts["cycles"], facts["cycles_torn"]) == (1, 0)
    status, _, _ = command("map", "export", path, "--out", tmp_path / "drive.json")
    assert status == 0
    exported = json.loads((tmp_path / "drive.json").read_text())
    assert [scan["scan"] for scan in exported["scans"]] == list(range(len(truth)))


def test_a_torn_cycle_is_told(command, small):
    status, out, _ = command("map", "info", small)
    assert status == 0
    assert "cycles torn: 1" in out
    assert "cycle 0-1-2: 9.4 m, misses its start by 0.4 m and 0.0°, torn" in out
    assert "worst arc assembled m: 0.4" in out
    facts = json.loads(command("map", "info", small, "--json")[1])
    assert facts["worst_arc_relaxed_m"] < 0.25


def test_a_path_is_a_table(command, small):
    status, out, err = command("map", "path", small, 0, 1)
    assert status == 0
    assert out.splitlines() == ["from,to,length_m,turn_deg,kind", "0,1,3.000,0.0,driven"]
    assert "1 arcs, 3.00 m" in err


@pytest.mark.parametrize("options", [(), ("--relaxed",), ("--root", "2", "--no-scans")])
def test_the_picture_is_a_png(command, small, tmp_path, options):
    status, _, _ = command("map", "show", small, "--out", tmp_path / "f.png", *options)
    assert status == 0
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "1 of 4 nodes left out: no arcs lead there from node 0"),
        (("--relaxed",), "1 of 4 nodes left out: no arcs lead there from node 0"),
        (("--root", "3"), "3 of 4 nodes left out: no arcs lead there from node 3"),
    ],
)
@pytest.mark.parametrize("words", [("show", "f.png"), ("export", "f.g2o"), ("export", "f.toro")])
def test_how_much_of_a_map_in_parts_is_left_out_is_one_line(
    command, small, tmp_path, words, options, said
):
    kind, name = words
    status, out, err = command("map", kind, small, "--out", tmp_path / name, *options)
    assert (status, out, err) == (0, "", f"{small}: {said}\n")


def test_nothing_is_said_where_the_whole_map_is_drawn(command, tmp_path):
    _, path, _ = mapped()
    for words in (("show", "f.png"), ("export", "f.g2o")):
        status, _, err = command("map", words[0], path, "--out", tmp_path / words[1])
        assert (status, err) == (0, "")


@pytest.mark.parametrize("chosen", ["score", "node-link", "graphml"])
@pytest.mark.parametrize("options", [("--relaxed",), ("--root", "0")])
def test_a_frame_is_refused_where_the_format_has_none(command, small, tmp_path, chosen, options):
    out = tmp_path / "out"
    status, _, err = command("map", "export", small, "--out", out, "--format", chosen, *options)
    assert status == 1
    assert err == f"aprjax: {out}: {chosen} has no frame of all nodes for {options[0]}\n"
    assert not out.exists()


def test_every_cycle_of_every_part_is_told_before_and_after_relaxation(command, tmp_path):
    world, count = WorldModel(), 7
    corner = np.array([3.0, 0.0, 2 * np.pi / 3])
    for part in range(count):
        a, b, c = (world.add_node() for _ in range(3))
        world.add_arc(Arc(a, b, corner, SURE, "driven"))
        world.add_arc(Arc(b, c, corner, SURE, "driven"))
        world.add_arc(Arc(c, a, corner + np.array([0.1 * part, 0, 0]), SURE, "closed"))
    save_map(world, tmp_path / "parts.map")
    facts = json.loads(command("map", "info", tmp_path / "parts.map", "--json")[1])
    listed = facts["cycle_residuals"]
    assert facts["cycles"] == len(listed) == count
    np.testing.assert_allclose([cycle["gap_m"] for cycle in listed], np.arange(count)[::-1] / 10)
    for cycle in listed:
        assert cycle["worst_arc_relaxed_m"] <= cycle["gap_m"]
        assert cycle["worst_arc_relaxed_deg"] < 2
    # A small gap is shared by all three arcs; a large one is left to an arc that gives way.
    for cycle in listed[-3:]:
        assert cycle["worst_arc_relaxed_m"] == pytest.approx(cycle["gap_m"] / 3, abs=0.01)
    assert facts["worst_arc_assembled_m"] == pytest.approx(0.6, abs=0.05)
    assert facts["worst_arc_relaxed_m"] == max(c["worst_arc_relaxed_m"] for c in listed)

    out = command("map", "info", tmp_path / "parts.map")[1].splitlines()
    assert "the worst 5 of 7 cycles:" in out
    assert sum(line.startswith("cycle ") for line in out) == 5


@pytest.mark.parametrize(
    ("name", "options", "start"),
    [
        ("f.json", (), '{\n "nodes"'),
        ("f.graphml", (), "<?xml"),
        ("f.g2o", (), "VERTEX_SE2 0 "),
        ("f.g2o", ("--relaxed",), "VERTEX_SE2 0 "),
        ("f.graph", (), "VERTEX2 0 "),
        ("f.txt", ("--format", "toro"), "VERTEX2 0 "),
        ("f.txt", ("--format", "node-link"), '{\n "directed"'),
    ],
)
def test_the_format_is_told_by_the_suffix_or_by_name(
    command, small, tmp_path, name, options, start
):
    status, _, _ = command("map", "export", small, "--out", tmp_path / name, *options)
    assert status == 0
    assert (tmp_path / name).read_text().startswith(start)


def test_bad_data_is_one_clear_line(command, small, log, tmp_path):
    out = tmp_path / "out"
    absent = tmp_path / "absent"
    for words, message in [
        (("info", absent), f"{absent}: No such file or directory"),
        (("info", log), f"{log}: not a map file"),
        (("path", small, 0, 9), f"{small}: node 9: the map has none, only 0 to 3"),
        (("path", small, 0, 3), f"{small}: node 3: no arcs lead there from 0"),
        (("show", small, "--out", out, "--root", 9), f"{small}: node 9: there is none"),
        (("export", small, "--out", out), f"{out}: say --format"),
        (("build", small, "--out", out), f"{small}: not a CARMEN log"),
        (("build", log, "--out", log), f"{log}: would overwrite what is read"),
        (("show", small, "--out", tmp_path / "no" / "f.png"), "cannot be written"),
    ]:
        status, printed, err = command("map", *words)
        assert (status, printed) == (1, ""), words
        assert message in err
        assert len(err.splitlines()) == 1
    assert not out.exists()


def test_bad_usage_is_told_apart(command):
    for words in (("map",), ("map", "path", "m", "a", "b"), ("map", "fly")):
        status, _, err = command(*words)
        assert status == 2
        assert "usage" in err


@pytest.mark.usefixtures("full_disk")
@pytest.mark.parametrize("words", [("show", "m.png"), ("export", "m.json"), ("export", "m.g2o")])
def test_a_full_disk_is_one_line_and_leaves_no_half_file(small, tmp_path, command, words):
    kind, name = words
    status, out, err = command("map", kind, small, "--out", tmp_path / name)
    assert (status, out) == (1, "")
    assert err == f"aprjax: {tmp_path / name}: File too large\n"
    assert not list(tmp_path.iterdir())


def test_standard_output_that_is_full_is_one_line(small):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "aprjax.cli.main", "map", "info", str(small)],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).resolve().parents[2],
        )
    assert (done.returncode, done.stderr) == (
        1,
        "aprjax: standard output: No space left on device\n",
    )
