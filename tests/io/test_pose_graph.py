import gzip
from pathlib import Path

import numpy as np
import pytest

import aprjax
from aprjax.io.pose_graph import (
    PoseGraph,
    PoseGraphEdge,
    PoseGraphError,
    pose_graph_text,
    read_pose_graph,
    write_pose_graph,
)

# Six different numbers, so that no two entries can be taken for each other.
INFORMATION = np.array([[11.0, 1.2, 1.3], [1.2, 22.0, 2.3], [1.3, 2.3, 33.0]])
IN_ORDER = {"g2o": "11 1.2 1.3 22 2.3 33", "toro": "11 1.2 22 33 1.3 2.3"}
VERTEX = {"g2o": "VERTEX_SE2", "toro": "VERTEX2"}
EDGE = {"g2o": "EDGE_SE2", "toro": "EDGE2"}


def graph() -> PoseGraph:
    poses = {7: np.array([1.0, -2.5, 3.0]), 0: np.zeros(3)}
    edges = [
        PoseGraphEdge(0, 7, np.array([1.0, -2.5, 3.0]), INFORMATION),
        PoseGraphEdge(7, 0, np.array([0.1, 0.2, -0.3]), np.eye(3)),
    ]
    return PoseGraph(poses, edges, fixed=[0])


@pytest.mark.parametrize("form", ["g2o", "toro"])
def test_the_information_matrix_is_written_in_the_order_of_the_format(form):
    lines = pose_graph_text(graph(), form).splitlines()
    ends = "1.000000000 -2.500000000 3.000000000"
    assert lines[:2] == [
        f"{VERTEX[form]} 0 {'0.000000000 ' * 3}".strip(),
        f"{VERTEX[form]} 7 {ends}",
    ]
    assert f"{EDGE[form]} 0 7 {ends} {IN_ORDER[form]}" in lines
    assert ("FIX 0" in lines) == (form == "g2o")


@pytest.mark.parametrize("form", ["g2o", "toro"])
def test_the_information_matrix_is_read_in_the_order_of_the_format(tmp_path, form):
    path = tmp_path / "graph"
    path.write_text(f"{EDGE[form]} 3 4 1 2 0.5 {IN_ORDER[form]}\n")
    (edge,) = read_pose_graph(path).edges
    assert (edge.a, edge.b) == (3, 4)
    np.testing.assert_array_equal(edge.T_a_b, [1, 2, 0.5])
    np.testing.assert_array_equal(edge.information, INFORMATION)


@pytest.mark.parametrize("suffix", [".g2o", ".graph", ".toro"])
def test_what_was_written_is_read_back(tmp_path, suffix):
    rng = np.random.default_rng(0)
    given = graph()
    for number in range(1, 6):
        given.poses[number] = rng.normal(size=3)
        root = rng.normal(size=(3, 3))
        given.edges.append(PoseGraphEdge(0, number, rng.normal(size=3), root @ root.T))
    path = tmp_path / f"graph{suffix}"
    aprjax.write_pose_graph(given, path)
    again = aprjax.read_pose_graph(path)
    assert sorted(again.poses) == sorted(given.poses)
    for vertex, pose in given.poses.items():
        np.testing.assert_allclose(again.poses[vertex], pose, atol=1e-9)
    assert [(edge.a, edge.b) for edge in again.edges] == [(e.a, e.b) for e in given.edges]
    for mine, theirs in zip(given.edges, again.edges, strict=True):
        np.testing.assert_allclose(theirs.T_a_b, mine.T_a_b, atol=1e-9)
        np.testing.assert_allclose(theirs.information, mine.information, rtol=1e-8)
    assert again.fixed == ([0] if suffix == ".g2o" else [])
    write_pose_graph(again, tmp_path / f"again{suffix}")
    assert (tmp_path / f"again{suffix}").read_bytes() == path.read_bytes()


def test_comments_are_left_out_and_other_lines_counted(tmp_path):
    path = tmp_path / "graph.g2o"
    path.write_text(
        "# made by hand\n\nVERTEX_SE2 0 0 0 0\r\nVERTEX_XY 5 1 1\nVERTEX_XY 6 1 1\n"
        "PARAMS_SE2OFFSET 0 0 0 0\nFIX 0\n"
    )
    found = read_pose_graph(path)
    assert found.skipped == {"VERTEX_XY": 2, "PARAMS_SE2OFFSET": 1}
    assert (list(found.poses), found.edges, found.fixed) == ([0], [], [0])


def test_a_fixed_landmark_is_left_out_with_it(tmp_path):
    path = tmp_path / "graph.g2o"
    path.write_text("FIX 5 0\nVERTEX_SE2 0 0 0 0\nVERTEX_XY 5 1 1\n")
    assert read_pose_graph(path).fixed == [0]
    path.write_text("VERTEX_SE2 0 0 0 0\nVERTEX_XY 5 1 1\nEDGE_SE2 0 5 1 2 3 1 0 0 1 0 1\n")
    with pytest.raises(PoseGraphError, match="line 3: there is no vertex 5"):
        read_pose_graph(path)


def test_toros_oldest_tags_are_known(tmp_path):
    path = tmp_path / "graph"
    path.write_text(f"VERTEX 1 0 0 0\nVERTEX 2 0 0 0\nEDGE 1 2 1 2 0.5 {IN_ORDER['toro']}\n")
    np.testing.assert_array_equal(read_pose_graph(path).edges[0].information, INFORMATION)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("VERTEX_SE2 1 0 0", "VERTEX_SE2 has 4 fields, not 5"),
        ("VERTEX_SE2 -1 0 0 0", "'-1' is not a vertex's number"),
        ("VERTEX_SE2 1.5 0 0 0", "'1.5' is not a vertex's number"),
        ("VERTEX_SE2 1" + "0" * 30 + " 0 0 0", "is not a vertex's number"),
        ("VERTEX_SE2 1 0 x 0", "'x' is not a number"),
        ("VERTEX_SE2 1 0 nan 0", "nan is not finite"),
        ("VERTEX2 1 0 1e999 0", "1e999 is not finite"),
        ("VERTEX_SE2 0 0 0 0", "vertex 0 is there twice"),
        ("EDGE_SE2 0 0 1 2 3 1 0 0 1 0", "EDGE_SE2 has 11 fields, not 12"),
        ("EDGE_SE2 0 9 1 2 3 1 0 0 1 0 1", "there is no vertex 9"),
        ("EDGE_SE2 0 0 1 2 3 1 0 0 1 0 -1", "is not positive semidefinite"),
        ("EDGE2 0 0 1 2 3 1 5 1 1 0 0", "is not positive semidefinite"),
        ("FIX x", "'x' is not a vertex's number"),
        ("FIX 9", "there is no vertex 9"),
    ],
)
def test_a_bad_line_is_named_by_its_number(tmp_path, line, message):
    path = tmp_path / "graph"
    path.write_text(f"VERTEX_SE2 0 0 0 0\n# a comment\n\n{line}\n")
    with pytest.raises(PoseGraphError, match=message) as caught:
        read_pose_graph(path)
    assert str(caught.value).startswith(f"{path}: line 4: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "neither a vertex nor an edge"),
        (b"\x00\xff\x01\n" * 100, "neither a vertex nor an edge"),
        (b"x" * (1 << 20), "neither a vertex nor an edge"),
        (b"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n" * 2, r"of the plane, only VERTEX_SE3:QUAT \(2\)"),
    ],
)
def test_a_file_that_is_no_graph_is_refused(tmp_path, data, message):
    path = tmp_path / "graph"
    path.write_bytes(data)
    with pytest.raises(PoseGraphError, match=message):
        read_pose_graph(path)
    with pytest.raises(PoseGraphError, match=r"nowhere: No such file"):
        read_pose_graph(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poses": {0: np.array([0, np.nan, 0])}}, r"poses\[0\]: .* not three finite"),
        ({"poses": {-1: np.zeros(3)}}, "vertex -1"),
        ({"edges": [PoseGraphEdge(0, 1, np.zeros(2), np.eye(3))]}, r"edges\[0\].T_a_b"),
        (
            {"edges": [PoseGraphEdge(0, 1, np.zeros(3), np.triu(INFORMATION))]},
            r"edges\[0\].information: .* not symmetric",
        ),
        ({"edges": [PoseGraphEdge(0, 1, np.zeros(3), np.eye(2))]}, r"edges\[0\].information"),
    ],
)
def test_a_graph_that_makes_no_sense_is_not_written(tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        write_pose_graph(PoseGraph(**change), tmp_path / "graph.g2o")
    assert not list(tmp_path.iterdir())


def test_the_format_is_told_by_the_suffix_or_by_name(tmp_path):
    write_pose_graph(graph(), tmp_path / "graph.txt", "toro")
    assert (tmp_path / "graph.txt").read_text().startswith("VERTEX2")
    with pytest.raises(ValueError, match=r"path: .*txt ends in none of .g2o"):
        write_pose_graph(graph(), tmp_path / "graph.txt")


def test_the_graphs_of_the_public_logs_are_read(data: Path, tmp_path):
    path = tmp_path / "mit-csail.graph"
    path.write_bytes(gzip.decompress((data / "logs" / "mit-csail.graph.log.gz").read_bytes()))
    found = read_pose_graph(path)
    assert (len(found.poses), len(found.edges)) == (1051, 1189)
    np.testing.assert_array_equal(found.edges[0].information, np.diag([100.0, 100.0, 500.0]))
    assert found.skipped["ROBOTLASER1"] == 1051
