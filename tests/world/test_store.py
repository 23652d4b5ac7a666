import json
import xml.etree.ElementTree as ElementTree

import jax
import networkx as nx
import numpy as np
import pytest

from aprjax import references
from aprjax.describing import described
from aprjax.world.export import graphml, node_link_json, pose_graph, score_json
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place, WorldModelError
from aprjax.world.store import MapFileError, load_map, save_map
from aprjax.world.super_space import assemble
from tests.worlds import office, scan_at


def refused(path) -> str:
    """The one line with which a file is refused, without its path."""
    with pytest.raises(MapFileError) as caught:
        load_map(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def same(one: WorldModel, other: WorldModel) -> None:
    assert one.nodes == other.nodes
    assert dict(one.graph.nodes(data="scan")) == dict(other.graph.nodes(data="scan"))
    for a, b in zip(one.arcs(), other.arcs(), strict=True):
        assert (a.a, a.b, a.kind) == (b.a, b.b, b.kind)
        np.testing.assert_array_equal(a.T_a_b, b.T_a_b)
        np.testing.assert_array_equal(a.covariance, b.covariance)
    for mine, theirs in ((one.appearances, other.appearances), (one.images, other.images)):
        assert mine.keys() == theirs.keys()
        for key, seen in mine.items():
            assert (seen.scan, seen.image_class) == (theirs[key].scan, theirs[key].image_class)
            assert seen.place.node == theirs[key].place.node
            np.testing.assert_array_equal(seen.place.T_node_laser, theirs[key].place.T_node_laser)
    assert one.places.keys() == other.places.keys()
    assert one.next_reference == other.next_reference
    assert one.reference_scans.keys() == other.reference_scans.keys()
    for reference, scan in one.reference_scans.items():
        again = other.reference_scans[reference]
        padded = scan.pad(again.ranges.shape[-1])
        for a, b in zip(jax.tree.leaves(padded), jax.tree.leaves(again), strict=True):
            assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


def test_round_trip_keeps_everything(square, tmp_path):
    square.remove_references([1])
    save_map(square, tmp_path / "map")
    loaded = load_map(tmp_path / "map")
    same(square, loaded)
    save_map(loaded, tmp_path / "again")
    assert (tmp_path / "again").read_bytes() == (tmp_path / "map").read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {"map", "again"}


def test_images_keep_their_numbers(square, tmp_path):
    square.add_image(Appearance(Place(2, np.zeros(3)), 20, image_class=3), 9)
    save_map(square, tmp_path / "map")
    loaded = load_map(tmp_path / "map")
    same(square, loaded)
    assert loaded.add_image(Appearance(Place(2, np.zeros(3)), 20, image_class=3)) == 10


def test_a_built_map_comes_back(built, tmp_path):
    save_map(built[0], tmp_path / "map")
    same(built[0], load_map(tmp_path / "map"))


def test_references_are_loaded_undescribed_until_something_is_matched_with_them(
    tmp_path, monkeypatch
):
    world = WorldModel()
    world.add_node(0)
    scan = scan_at(office(seed=5), np.array([3.0, 0.0, 0.0]))
    seen = Appearance(Place(0, np.zeros(3)), 0)
    world.add_references([scan] * 100, [seen] * 100)
    save_map(world, tmp_path / "map")
    counted = []
    monkeypatch.setattr(
        references, "described", lambda scans, by: counted.append(scans) or described(scans, by)
    )
    loaded = load_map(tmp_path / "map")
    assert len(loaded.appearances) == 100
    assert not counted
    assert len(loaded.references) == 100
    assert len(counted) == 1


def test_nothing_is_written_of_an_empty_or_broken_model(square, tmp_path):
    with pytest.raises(ValueError, match="no node"):
        save_map(WorldModel(), tmp_path / "map")
    square.places[3] = Place(77, np.zeros(3))
    with pytest.raises(WorldModelError, match="node 77"):
        save_map(square, tmp_path / "map")
    assert not list(tmp_path.iterdir())


def test_foreign_and_cut_off_files(square, tmp_path):
    path = tmp_path / "map"
    assert refused(path) == "No such file or directory"
    path.write_bytes(b"")
    assert refused(path) == "the file is empty"
    path.write_bytes(b"ODOM 0 0 0")
    assert refused(path) == "not a map file"
    np.savez(tmp_path / "other.npz", ranges=np.zeros(3))
    assert refused(tmp_path / "other.npz") == "an archive, but not a map file"
    save_map(square, path)
    data = path.read_bytes()
    for length in range(2, len(data), len(data) // 40):
        path.write_bytes(data[:length])
        assert refused(path) == "cut off or damaged: not a readable archive"


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("version", lambda a: a + 1, "version 2 is newer than 1"),
        ("version", lambda a: a - 1, "version 0 does not exist"),
        ("nodes", lambda a: a.astype(float), "nodes is float64, not int64"),
        ("nodes", lambda a: a[:0], "there are no nodes"),
        ("nodes", lambda a: 0 * a, "node 0: there is one already"),
        ("nodes", lambda a: a - 1, "node -1: ids are not negative"),
        ("node_scans", lambda a: a[1:], "node_scans has shape (4,), not (5)"),
        ("arcs", lambda a: a + 3, "there is no node"),
        ("arc_poses", lambda a: a[:, :2], "arc_poses has shape (4, 2), not (4, 3)"),
        ("arc_poses", lambda a: a * np.nan, "no pose of three finite numbers"),
        ("arc_poses", lambda a: a + 1e300, "has numbers over 1e+07"),
        ("arc_covariances", lambda a: -a, "negative eigenvalue"),
        ("arc_covariances", lambda a: a * 1e300, "its covariance has entries over 1e+14"),
        ("place_poses", lambda a: a - 1e308, "has numbers over 1e+07"),
        ("place_scans", lambda a: a - 1, "place_scans[0]: -1 is negative"),
        ("place_scans", lambda a: 0 * a, "place_scans[1]: 0 does not follow 0"),
        ("node_scans", lambda a: a - 2, "node 0: there is no scan -2"),
        ("arc_kinds", lambda a: a + 5, "its kind 5 does not exist"),
        ("place_nodes", lambda a: a + 1, "there is no node 5"),
        ("nodes", lambda a: a + 2**32, "node 4294967296: ids are at most 2147483647"),
        ("reference_ids", lambda a: a[::-1], "reference_ids[1]: 1 does not follow 2"),
        ("reference_ids", lambda a: a - 1, "reference_ids[0]: -1 is negative"),
        ("reference_ids", lambda a: a + 2**32, "next_id: 3 does not follow 4294967298"),
        ("next_id", lambda a: a - 1, "next_id: 2 does not follow 2"),
        ("next_id", lambda a: a + 2**32, "the next id 4294967299 is not from 0 to 2147483647"),
        ("reference_poses", lambda a: a / 0, "no pose of three finite numbers"),
        ("reference_poses", lambda a: a + 1e308, "has numbers over 1e+07"),
        ("ranges", lambda a: a[1:], "ranges has shape"),
        (
            "angle_increment",
            lambda a: 0 * a,
            "angle_increment[0]: 0.0 is zero, or the beams pass",
        ),
        ("image_classes", lambda a: a[:0], "image_ids has shape (1,), not (0)"),
        ("image_ids", lambda a: a - 1, "image -1: ids are not negative"),
        ("features", lambda a: np.array("{"), "features is not JSON"),
        ("features", None, "features is missing"),
        (
            "features",
            lambda a: np.array('{"extraction": {"virtual_edge": {"direction_bins": 0}}}'),
            "direction_bins is not a whole number from 1",
        ),
    ],
)
def test_contents_that_no_map_can_have_are_named(square, tmp_path, name, change, message):
    save_map(square, tmp_path / "map")
    with np.load(tmp_path / "map") as archive:
        arrays = {key: archive[key] for key in archive.files}
    with np.errstate(all="ignore"):
        changed = {} if change is None else {name: change(arrays.pop(name))}
    arrays.pop(name, None)
    with (tmp_path / "map").open("wb") as file:
        np.savez_compressed(file, **arrays, **changed)
    assert message in refused(tmp_path / "map")


def test_the_exports_are_read_by_others(square):
    scored = json.loads(score_json(square))
    assert scored["nodes"][1] == {"id": 1, "scan": 10}
    assert scored["arcs"][0] | {"x": 2.0, "kind": "driven"} == scored["arcs"][0]
    assert [scan["scan"] for scan in scored["scans"]] == [0, 10, 20, 30, 40]

    graph = nx.node_link_graph(json.loads(node_link_json(square)), edges="links")
    assert nx.is_isomorphic(graph, square.graph)
    assert graph.nodes[0]["appearances"][1]["arc_to"] == 3
    assert graph.nodes[1]["images"][0]["image_class"] == 7

    plain = nx.parse_graphml(graphml(square), node_type=int)
    assert nx.utils.edges_equal(plain.edges, square.graph.edges)
    assert plain.nodes[0]["references"] == 2
    ElementTree.fromstring(graphml(square))

    poses = pose_graph(square, assemble(square))
    assert len(poses.edges) == 4
    assert poses.fixed == [0]
    # The inverse of a square centimetre.
    assert poses.edges[0].information[0, 0] == pytest.approx(1e4, rel=1e-3)


def test_information_of_a_pose_graph_is_along_the_axes_of_an_edges_end():
    world = WorldModel()
    for _ in range(2):
        world.add_node()
    quarter = np.array([2.0, 1.0, np.pi / 2])
    # In a's frame sure of y, which is b's x.
    world.add_arc(Arc(0, 1, quarter, np.diag([1.0, 1e-4, 1e-2]), "driven"))
    edge = pose_graph(world, assemble(world)).edges[0]
    np.testing.assert_allclose(edge.information, np.diag([1e4, 1.0, 1e2]), rtol=1e-6, atol=1e-3)


def test_a_node_without_a_scan_cannot_be_scored(square):
    square.add_node()
    with pytest.raises(WorldModelError, match="node 5"):
        score_json(square)
