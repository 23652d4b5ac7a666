import json

import numpy as np
import pytest

from aprjax.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from aprjax.io.occupancy_grid import write_occupancy_grid
from aprjax.io.reference_file import save_references
from aprjax.references import ReferenceSet
from aprjax.world.model import WorldModel
from aprjax.world.parts import Arc
from aprjax.world.store import save_map
from tests.worlds import free_pose, office, scan_at


def facts_of(text):
    return dict(line.split(": ", 1) for line in text.splitlines())


def test_a_log(logs, command):
    status, out, err = command("info", logs[1])
    assert (status, err) == (0, "")
    facts = facts_of(out)
    assert facts["file"] == str(logs[1])
    assert facts["kind"] == "CARMEN log"
    assert facts["scans"] == "20"
    assert facts["lasers"] == "ROBOTLASER1"
    assert facts["beams"] == "181"
    assert facts["field of view deg"] == "180.0"
    assert facts["resolution deg"] == "1.0"
    assert facts["first beam deg"] == "-90.0"
    assert facts["range max m"] == "30.0"
    assert facts["saturation m"] == "none"
    assert facts["odometry"] == "yes"
    assert facts["damaged lines"] == "0"
    assert 4 < float(facts["anchors per scan"]) < 16


def test_shares_saturation_damage_and_unknown_lines(tmp_path, command):
    rng = np.random.default_rng(0)
    lines = ["# made up\n", "NEFF 12\n", "NEFF 13\n", "FLASER 3 1\n"]
    for _ in range(20):
        ranges = [*rng.uniform(1, 9, 90), *[50.0] * 60, *[81.91] * 30]
        words = " ".join(f"{value:.2f}" for value in ranges)
        lines.append(f"FLASER 180 {words} 0 0 0 0 0 0 0 host 0\n")
    path = tmp_path / "made-up.log"
    path.write_text("".join(lines))
    status, out, _ = command("info", path, "--json")
    assert status == 0
    facts = json.loads(out)
    assert (facts["hits_share"], facts["no_return_share"], facts["invalid_share"]) == (
        0.5,
        0.3333,
        0.1667,
    )
    assert facts["saturation_m"] == facts["range_max_m"] == 50.0
    assert facts["field_of_view_deg"] == 179.0
    assert facts["odometry"] is False
    assert facts["damaged_lines"] == 1
    assert facts["damage"][0].startswith("line 4: ")
    assert (facts["unknown_lines"], facts["unknown_kinds"]) == (2, ["NEFF"])


def test_a_reference_file(tmp_path, command):
    world, rng = office(seed=2), np.random.default_rng(0)
    scans = [scan_at(world, free_pose(world, rng)) for _ in range(12)]
    path = tmp_path / "references"
    references = ReferenceSet.build(scans).remove([11])
    save_references(references, path)
    status, out, err = command("info", path)
    assert (status, err) == (0, "")
    facts = facts_of(out)
    assert facts["kind"] == "reference file"
    assert (facts["version"], facts["references"], facts["next id"]) == ("2", "11", "12")
    assert facts["anchor capacity"] == "16"
    valid = np.asarray(references.index.features.anchors.valid)[:11]
    assert float(facts["anchors per scan"]) == pytest.approx(valid.sum(axis=1).mean(), abs=0.01)


def test_a_map(tmp_path, command):
    world = WorldModel()
    for node in range(3):
        world.add_node(node)
    world.add_arc(Arc(0, 1, np.array([3.0, 0.0, 0.0]), np.diag([1e-3, 1e-3, 1e-4]), "driven"))
    path = tmp_path / "office"
    save_map(world, path)
    status, out, err = command("info", path)
    assert (status, err) == (0, "")
    facts = facts_of(out)
    assert facts["kind"] == "map file"
    assert (facts["nodes"], facts["parts"], facts["arcs"]) == ("3", "2", "1")
    assert (facts["length m"], facts["references"], facts["cycles torn"]) == ("3.0", "0", "0")


def test_a_grid(tmp_path, command):
    cells = np.full((4, 6), FREE)
    cells[0] = OCCUPIED
    write_occupancy_grid(
        OccupancyGrid.make(cells, 0.5, [1.0, -2.0, np.pi / 2]), tmp_path / "g.yaml"
    )
    facts = facts_of(command("info", tmp_path / "g.yaml")[1])
    assert facts["kind"] == "occupancy grid"
    assert (facts["cells"], facts["size m"], facts["origin"]) == ("6 x 4", "3.00 x 2.00", "1 -2 90")
    assert (facts["free m2"], facts["occupied m2"]) == ("4.5", "1.5")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file or directory"),
        (b"", "the file is empty"),
        (b"hello\n", "not a CARMEN log"),
        (b"PK\x03\x04", "cut off or damaged"),
        (b"\x1f\x8b\x08\x00", "cut off"),
    ],
)
def test_bad_data_is_one_line(tmp_path, command, content, reason):
    path = tmp_path / "file"
    if content is not None:
        path.write_bytes(content)
    status, out, err = command("info", path)
    assert (status, out) == (1, "")
    assert err.startswith(f"aprjax: {path}: ")
    assert reason in err
    assert err.count("\n") == 1
