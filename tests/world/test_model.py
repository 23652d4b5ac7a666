import numpy as np
import pytest

from aprjax.plane import compose, inverse
from aprjax.references import ReferenceSet
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, ArcEnd, Place, WorldModelError
from aprjax.world.super_space import between

EXACT = np.zeros((3, 3))


def place(node, *T):
    return Place(node, np.array(T or (0, 0, 0), float))


def restored(world, ids, next_reference, like=2):
    """Restore references at node 3 with the scan of another one."""
    count = len(ids)
    scan, seen = world.reference_scans[like], Appearance(place(3))
    world.restore_references(ids, [scan] * count, [seen] * count, next_reference)


def test_an_arc_is_the_inverse_when_seen_from_its_other_end(square):
    there, back = square.arc(0, 1), square.arc(1, 0)
    assert (back.a, back.b) == (1, 0)
    np.testing.assert_allclose(compose(there.T_a_b, back.T_a_b), 0, atol=1e-12)
    np.testing.assert_allclose(
        back.seen_from(0).covariance, there.covariance, rtol=1e-9, atol=1e-12
    )


def test_what_was_seen_belongs_to_the_arc_it_looks_along_in_either_direction(square):
    # From node 0, node 1 lies ahead and node 3 on the left.
    ends = [square.arc_end(square.appearances[reference]) for reference in (0, 1, 2)]
    assert ends == [ArcEnd(0, 1, True), ArcEnd(0, 3, True), ArcEnd(2, 3, True)]
    back = Appearance(place(0, 0.0, 0.0, np.pi - 0.1))
    assert square.arc_end(back) == ArcEnd(0, 1, False)
    assert square.arc_end(Appearance(place(4, 0.0, 0.0, 0.0))) == ArcEnd(4, None, True)
    assert square.seen_along(0, 1) == [0]
    assert square.seen_along(0, 3) == [1]
    assert square.seen_along(1, 0) == []


def test_references_keep_their_ids_and_follow_the_edits(square):
    assert square.references.ids.tolist() == [0, 1, 2]
    scan = square.reference_scans[0]
    square.remove_references([1])
    assert square.add_references([scan], [Appearance(place(3, 0, 0, 0), 31)]) == [3]
    assert square.references.ids.tolist() == [0, 2, 3]
    square.remove_references([3])
    assert square.add_references([scan], [Appearance(place(3, 0, 0, 0), 31)]) == [4]
    assert square.references.ids.tolist() == [0, 2, 4]
    assert square.references.next_id == 5
    square.check()


def test_a_node_that_is_split_leaves_everything_where_it_was(square):
    before = {k: between(square, place(1), seen.place)[0] for k, seen in square.appearances.items()}
    T_3_new = square.arc(3, 0).T_a_b + 0.0
    new = square.split_node(2, np.array([1.5, 0.0, 0.3]), EXACT + 1e-12 * np.eye(3), [3])
    square.check()
    assert set(square.graph[new]) == {2, 3}
    assert set(square.graph[2]) == {1, new}
    assert square.appearances[2].place.node == new
    np.testing.assert_allclose(square.arc(3, 0).T_a_b, T_3_new)
    for k, seen in square.appearances.items():
        if k != 2:
            continue
        np.testing.assert_allclose(between(square, place(1), seen.place)[0], before[k], atol=1e-9)


def test_a_node_with_another_frame_leaves_everything_where_it_was(square):
    square.place_scan(21, place(2, 0.4, -0.1, 0.7))
    scan, before = place(2, 0.4, -0.1, 0.7), {}
    for node in (1, 3):
        before[node] = between(square, place(node), scan)[0]
    seen = between(square, place(1), square.appearances[2].place)[0]
    uncertain = np.diag([0.01, 0.01, 0.001])
    square.move_frame(2, 21, uncertain)
    square.check()
    assert square.graph.nodes[2]["scan"] == 21
    np.testing.assert_allclose(square.places[21].T_node_laser, 0, atol=1e-12)
    for node in (1, 3):
        np.testing.assert_allclose(square.arc(node, 2).T_a_b, before[node], atol=1e-12)
        assert np.trace(square.arc(node, 2).covariance) >= np.trace(uncertain)
    np.testing.assert_allclose(
        between(square, place(1), square.appearances[2].place)[0], seen, atol=1e-12
    )
    with pytest.raises(WorldModelError, match="node 1: scan 21 is not placed in it"):
        square.move_frame(1, 21, uncertain)


def test_nodes_that_are_merged_leave_everything_where_it_was(square):
    before = between(square, place(0), square.images[0].place)[0]
    square.merge_nodes(0, 1)
    square.check()
    assert square.nodes == [0, 2, 3, 4]
    assert set(square.graph[0]) == {2, 3}
    assert square.images[0].place.node == 0
    np.testing.assert_allclose(between(square, place(0), square.images[0].place)[0], before)
    assert square.places[10].node == 0


def test_splitting_and_merging_again_gives_the_same_map(square):
    arcs = {(arc.a, arc.b): arc.T_a_b for arc in square.arcs()}
    seen = {k: appearance.place.T_node_laser for k, appearance in square.appearances.items()}
    new = square.split_node(2, np.array([1.5, 0.0, 0.3]), 1e-12 * np.eye(3), [3])
    square.merge_nodes(2, new)
    for (a, b), T in arcs.items():
        np.testing.assert_allclose(square.arc(a, b).T_a_b, T, atol=1e-9)
    for k, T in seen.items():
        np.testing.assert_allclose(square.appearances[k].place.T_node_laser, T, atol=1e-9)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda w: w.add_node(node=2), "node 2: there is one already"),
        (lambda w: w.add_node(node=2**31), "node 2147483648: ids are at most"),
        (lambda w: w.add_node(node=1.5), "node 1.5: ids are whole numbers"),
        (lambda w: w.add_node(-3), "node 5: there is no scan -3"),
        (lambda w: w.add_node(2.5), "node 5: there is no scan 2.5"),
        (lambda w: w.add_arc(Arc(0, 9, np.zeros(3), EXACT, "driven")), "no node 9"),
        (lambda w: w.add_arc(Arc(0, 1, np.zeros(3), EXACT, "driven")), "between 0 and 1 already"),
        (lambda w: w.add_arc(Arc(0, 0, np.zeros(3), EXACT, "driven")), "starts where it ends"),
        (lambda w: w.add_arc(Arc(0, 4, np.zeros(3), EXACT, "flown")), "'flown' is none of"),
        (lambda w: w.add_arc(Arc(0, 4, np.full(3, np.nan), EXACT, "driven")), "no pose"),
        (lambda w: w.add_arc(Arc(0, 4, np.full(3, 1e8), EXACT, "driven")), "numbers over 1e.07"),
        (lambda w: w.add_arc(Arc(0, 4, np.zeros(3), 1e15 * np.eye(3), "driven")), "over 1e.14"),
        (lambda w: w.add_arc(Arc(0, 4, np.zeros(3), -np.eye(3), "driven")), "negative eigenvalue"),
        (lambda w: w.add_arc(Arc(0, 4, np.zeros(3), np.triu(np.ones((3, 3))), "driven")), "symm"),
        (lambda w: w.replace_arc(Arc(0, 4, np.zeros(3), EXACT, "driven")), "none between 0 and 4"),
        (lambda w: w.remove_arc(0, 2), "none between 0 and 2"),
        (lambda w: w.merge_nodes(0, 2), "none between 0 and 2"),
        (lambda w: w.split_node(9, np.zeros(3), EXACT), "no node 9"),
        (lambda w: w.split_node(0, np.zeros(3), EXACT, [2]), "none between 0 and 2"),
        (lambda w: w.split_node(0, np.zeros(3), EXACT, [1, 2]), "none between 0 and 2"),
        (lambda w: w.split_node(0, np.array([-1e7, 0, 0]), EXACT, [1]), "arc 5-1: .* over 1e.07"),
        (lambda w: w.remove_references([0, 9]), "reference 9: there is none"),
        (lambda w: w.add_references([], [Appearance(place(0, 0, 0, 0))]), "do not fit"),
        (lambda w: w.place_scan(3, place(9, 0, 0, 0)), "scan 3: there is no node 9"),
        (lambda w: w.place_scan(3, place(0, 0, np.inf, 0)), "no pose of three finite numbers"),
        (lambda w: w.place_scan(3, place(0, 0, -1e8, 0)), "scan 3: .* has numbers over 1e.07"),
        (lambda w: w.place_scan(-3, place(0, 0, 0, 0)), "scan -3: there is no scan -3"),
        (lambda w: w.restore_references([], [], [], 2**31), "next id 2147483648 is not from 0"),
        (lambda w: restored(w, [3], 3), "reference 3: the next id is 3"),
        (lambda w: restored(w, [], 2), "the next id 2 is less than 3"),
        (lambda w: restored(w, [2], 4), "reference 2: there is one already"),
        (lambda w: restored(w, [5, 3, 5], 6), "reference 5: there is one already"),
        (lambda w: restored(w, [-1], 4), "reference -1: ids are not negative"),
        (lambda w: restored(w, [3.5], 4), "reference 3.5: ids are whole numbers"),
        (lambda w: w.restore_references([3], [], [], 4), "1 ids, 0 scans and 0 appearances do not"),
        (lambda w: w.add_image(Appearance(place(0), image_class=1), 0), "image 0: there is one"),
        (lambda w: w.add_image(Appearance(place(0, 0, 0, 0))), "it has no class"),
    ],
)
def test_an_edit_that_does_not_fit_is_refused_and_changes_nothing(square, edit, message):
    arcs, nodes = [(arc.a, arc.b) for arc in square.arcs()], square.nodes
    scans = square.reference_scans
    with pytest.raises(WorldModelError, match=message):
        edit(square)
    square.check()
    assert [(arc.a, arc.b) for arc in square.arcs()] == arcs
    assert square.nodes == nodes
    assert sorted(square.appearances) == [0, 1, 2]
    assert square.reference_scans == scans
    assert square.next_reference == 3


def test_an_arc_that_is_named_twice_moves_once_when_its_node_is_split(square):
    new = square.split_node(1, np.array([0.5, 0.0, 0.0]), 1e-6 * np.eye(3), [2, 2])
    square.check()
    assert set(square.graph[new]) == {1, 2}
    assert set(square.graph[1]) == {0, new}


@pytest.mark.parametrize(
    "edit",
    [
        lambda w: w.merge_nodes(0, 1),
        lambda w: w.move_frame(0, 50, EXACT),
    ],
)
def test_an_edit_that_takes_an_arc_too_far_is_refused_and_changes_nothing(square, edit):
    far = np.array([9e6, 0.0, 0.0])
    square.replace_arc(Arc(0, 1, far, EXACT, "driven"))
    square.add_arc(Arc(1, 4, far, EXACT, "driven"))
    square.replace_arc(Arc(3, 0, far, EXACT, "driven"))
    square.place_scan(50, Place(0, far))
    arcs = {(arc.a, arc.b): arc for arc in square.arcs()}
    with pytest.raises(WorldModelError, match=r"has numbers over 1e\+07"):
        edit(square)
    square.check()
    assert {(arc.a, arc.b): arc for arc in square.arcs()} == arcs


def test_a_reference_restored_with_another_scan_is_described_anew(square):
    described = square.references
    square.remove_references([1])
    restored(square, [1], 3, like=0)
    assert square.references.ids.tolist() == [0, 1, 2]
    for found, expected in ((0, 0), (1, 0), (2, 2)):
        np.testing.assert_array_equal(
            square.references.index.features.anchors.xy[found],
            described.index.features.anchors.xy[expected],
        )


def test_references_restored_below_others_are_in_order(square):
    square.remove_references([0, 1])
    assert square.references.ids.tolist() == [2]
    restored(square, [0], 3)
    assert square.references.ids.tolist() == [0, 2]
    assert square.references.next_id == 3


def test_new_references_are_described_together_and_ids_taken_back_are_not_given_again(
    square, monkeypatch
):
    described, add = [], ReferenceSet.add

    def counted(self, scans):
        described.append(len(scans))
        return add(self, scans)

    monkeypatch.setattr(ReferenceSet, "add", counted)
    _ = square.references
    scan, seen = square.reference_scans[0], Appearance(place(3))
    square.add_references([scan] * 4, [seen] * 4)
    assert square.references.ids.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert described == [4]
    square.remove_references(square.add_references([scan], [seen]))
    assert square.references.ids.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert square.references.next_id == square.next_reference == 8
    assert square.references is square.references


def test_a_broken_invariant_is_found(square):
    square.appearances[0] = Appearance(place(8, 0, 0, 0))
    with pytest.raises(WorldModelError, match="reference 0: there is no node 8"):
        square.check()


def test_without_references_there_is_no_set_of_them():
    with pytest.raises(WorldModelError, match="has none"):
        _ = WorldModel().references


def test_the_inverse_of_a_pose_is_its_inverse():
    T = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [-1.0, 0.5, -2.0]])
    np.testing.assert_allclose(compose(T, inverse(T)), 0, atol=1e-12)
