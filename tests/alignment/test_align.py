import jax
import numpy as np
import pytest

from aprjax.alignment.align import AlignmentConfig
from tests.oracles.alignment import apart
from tests.relations.graphs import graph, moved, scattered


def inverse(pose):
    x, y, theta = pose
    return (*-moved((0, 0, -theta), [(x, y)])[0], -theta)


def errors(found, pose):
    """Metres and radians of each alternative off the pose, infinite where not valid."""
    gap = np.linalg.norm(found.T_ref_query[:, :2] - pose[:2], axis=-1)
    turn = np.array([apart(float(theta), pose[2], 2 * np.pi) for theta in found.T_ref_query[:, 2]])
    return np.where(found.valid, gap, np.inf), np.where(found.valid, turn, np.inf)


def offers(found, pose, metres, radians):
    gap, turn = errors(found, pose)
    return bool(((gap <= metres) & (turn <= radians)).any())


POSES = [(1.0, -2.0, 0.5), (-4.0, 0.3, -2.9), (0.0, 0.0, 0.0), (2.0, 2.0, np.pi / 2)]


@pytest.mark.parametrize("pose", POSES)
def test_a_moved_graph_is_aligned_exactly_and_first(alignment, pose):
    xy = scattered(1, 9)
    found = alignment(graph(xy), graph(moved(inverse(pose), xy)))
    gap, turn = errors(found, pose)
    assert gap[0] < 1e-3
    assert turn[0] < 1e-3
    assert found.anchors[0] == 9
    assert found.votes[0] >= 8


@pytest.mark.parametrize("seed", range(8))
def test_a_noisy_part_with_outliers_is_aligned(alignment, seed):
    """Seven of twelve anchors are seen again, to 2 cm, among five that are not there."""
    rng = np.random.default_rng(seed)
    xy = scattered(40 + seed, 12)
    pose = (*rng.uniform(-3, 3, 2), rng.uniform(-np.pi, np.pi))
    seen = moved(inverse(pose), xy[rng.permutation(12)[:7]]) + rng.normal(0, 0.02, (7, 2))
    query = rng.permutation(np.concatenate([seen, rng.uniform(-6, 6, (5, 2))]))
    found = alignment(graph(xy), graph(query))
    assert offers(found, pose, 0.1, 0.03)
    gap, turn = errors(found, pose)
    best = np.flatnonzero((gap <= 0.1) & (turn <= 0.03))[0]
    assert found.anchors[best] >= 7
    assert found.anchors[best] == found.anchors[found.valid].max()


@pytest.mark.parametrize("seed", range(3))
def test_exchanging_the_graphs_inverts_the_alignment(alignment, seed):
    pose = POSES[seed]
    xy = scattered(60 + seed, 10)
    there, back = graph(xy), graph(moved(inverse(pose), xy))
    assert offers(alignment(there, back), pose, 1e-3, 1e-3)
    assert offers(alignment(back, there), inverse(pose), 1e-3, 1e-3)


def test_a_square_is_aligned_in_all_four_rotations(alignment):
    corners = moved((0.5, 0.2, 0.3), [(2, 2), (-2, 2), (-2, -2), (2, -2)])
    pose = (1.0, -0.5, 0.7)
    found = alignment(graph(corners), graph(moved(inverse(pose), corners)))
    for quarter in range(4):
        turn = quarter * np.pi / 2
        # A quarter turn about the middle of the square, after the pose.
        about = np.array([0.5, 0.2])
        xy = about + moved((0, 0, turn), [np.array(pose[:2]) - about])[0]
        assert offers(found, (*xy, pose[2] + turn), 0.01, 0.01), quarter
    assert (found.anchors[found.valid] >= 2).all()


def test_a_rectangle_is_aligned_in_both_half_turns(alignment):
    corners = np.array([(3.0, 1.0), (-3.0, 1.0), (-3.0, -1.0), (3.0, -1.0)])
    found = alignment(graph(corners), graph(corners))
    assert offers(found, (0, 0, 0), 0.01, 0.01)
    assert offers(found, (0, 0, np.pi), 0.01, 0.01)
    full = found.valid & (found.anchors == 4)
    assert full.sum() == 2


def test_a_mirror_image_is_told_from_the_original(alignment):
    xy = scattered(7, 10)
    original, mirror = graph(xy), graph(xy * [1, -1])
    same, other = alignment(original, original), alignment(original, mirror)
    assert same.anchors[same.valid].max() == 10
    assert other.anchors[other.valid].max() <= 5


def test_each_alternative_agrees_with_as_many_anchors_as_it_says(alignment):
    xy, query = scattered(8, 11), scattered(9, 13)
    found = alignment(graph(xy), graph(query))
    assert found.valid.any()
    for pose, anchors, valid in zip(found.T_ref_query, found.anchors, found.valid, strict=True):
        gaps = np.linalg.norm(xy[:, None] - moved(pose, query), axis=-1).min(axis=0)
        if valid and not np.isclose(gaps, 0.25, atol=1e-3).any():
            assert anchors == (gaps <= 0.25).sum()


def test_alternatives_come_with_falling_maxima(alignment):
    for seed in range(4):
        found = alignment(graph(scattered(seed, 12)), graph(scattered(seed + 50, 12)))
        assert (np.diff(found.votes) <= 0).all()


def test_the_order_of_the_anchors_does_not_move_the_best_alignment(alignment):
    xy, pose = scattered(13, 10), POSES[0]
    query = moved(inverse(pose), xy)
    rng = np.random.default_rng(0)
    for _ in range(3):
        found = alignment(graph(rng.permutation(xy)), graph(rng.permutation(query)))
        assert errors(found, pose)[0][0] < 1e-3


@pytest.mark.parametrize("fill", [0.0, np.nan, np.inf])
def test_padding_changes_no_alignment(alignment, fill):
    xy, pose = scattered(14, 8), POSES[1]
    query = moved(inverse(pose), xy)
    clean = alignment(graph(xy), graph(query))
    found = alignment(graph(xy, fill=fill), graph(query, fill=fill))
    for leaf, other in zip(jax.tree.leaves(found), jax.tree.leaves(clean), strict=True):
        np.testing.assert_array_equal(leaf, other)


EDGE_CASES = {
    "no anchors": ([], None),
    "one anchor": ([(1, 2)], None),
    "duplicates": ([(1, 2)] * 5, None),
    "all masked": (scattered(1, 9), np.zeros(9, bool)),
    "one left": (scattered(1, 9), np.arange(9) == 4),
}


@pytest.mark.parametrize("name", EDGE_CASES)
@pytest.mark.parametrize("side", ["reference", "query", "both"])
def test_graphs_without_edges_have_no_alternative_and_finite_poses(alignment, name, side):
    full = graph(scattered(1, 9))
    xy, valid = EDGE_CASES[name]
    empty = graph(xy, valid)
    graphs = {"reference": (empty, full), "query": (full, empty), "both": (empty, empty)}[side]
    found = alignment(*graphs)
    assert not found.valid.any()
    for leaf in jax.tree.leaves(found):
        assert np.isfinite(leaf).all()


def test_two_anchors_are_aligned_either_way_round(alignment):
    pair, pose = np.array([(0.0, 0.0), (3.0, 1.0)]), POSES[0]
    found = alignment(graph(pair), graph(moved(inverse(pose), pair)))
    assert offers(found, pose, 1e-3, 1e-3)
    middle = np.array([1.5, 0.5])
    xy = middle + moved((0, 0, np.pi), [np.array(pose[:2]) - middle])[0]
    assert offers(found, (*xy, pose[2] + np.pi), 1e-3, 1e-3)


def test_more_anchors_are_asked_for_than_agree(alignment):
    pair = graph([(0.0, 0.0), (3.0, 1.0)])
    assert not alignment(pair, pair, AlignmentConfig(min_anchors=3)).valid.any()


def test_graphs_of_other_lengths_have_no_alternative(alignment):
    found = alignment(graph([(0, 0), (1, 0)]), graph([(0, 0), (5, 0)]))
    assert not found.valid.any()


def test_graphs_of_different_capacities_may_be_aligned(alignment):
    xy, pose = scattered(15, 6), POSES[0]
    found = alignment(graph(xy), graph(moved(inverse(pose), xy), slots=8))
    assert offers(found, pose, 1e-3, 1e-3)


def test_no_threshold_compiles_anew(alignment):
    graphs, config = (graph(scattered(1, 9)), graph(scattered(1, 9))), AlignmentConfig()
    alignment(*graphs)
    traces = alignment.traces
    leaves, structure = jax.tree.flatten(config)
    assert len(leaves) >= 6
    for k, leaf in enumerate(leaves):
        changed = [*leaves[:k], leaf * np.float32(0.9), *leaves[k + 1 :]]
        alignment(*graphs, jax.tree.unflatten(structure, changed))
    assert alignment.traces == traces
