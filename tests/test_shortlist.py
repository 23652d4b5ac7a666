import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.alignment.align import AlignmentConfig, Alternatives
from aprjax.alignment.voting import Votes
from aprjax.references import ReferenceSet
from aprjax.shortlist import (
    ShortlistConfig,
    all_alternatives,
    glance_through,
    look_closer,
    shortlist,
)
from tests.oracles import evaluation as oracle
from tests.worlds import office, scan_at

MAXIMA = 3
QUERY = np.array([12.4, 0.1, 0.2])
PLACES = np.array([[12.0, 0.0, 0.3], [6.0, 0.2, 0.0], [13.0, -0.2, 0.1], [18.0, 0.0, 2.0]])
ALIGNMENT = AlignmentConfig()

_shortlist, _glance_through = jax.jit(shortlist), jax.jit(glance_through)
_look_closer = jax.jit(look_closer)


@pytest.fixture(scope="module")
def scene():
    """Four places, a query, and votes for three poses in each, worst reference first.

    Of two references, the second pose is the true one.
    """
    world = office(seed=3)
    scans = [scan_at(world, pose) for pose in (*PLACES, QUERY)]
    index = ReferenceSet.build(scans).index
    query = jax.tree.map(lambda array: array[4], index.features)
    rng = np.random.default_rng(0)
    T = rng.uniform(-2, 2, (4, MAXIMA, 3)).astype(np.float32)
    for row in (0, 2):
        T[row, 1] = oracle.between(PLACES[row], QUERY) + np.array([0.05, -0.05, 0.02])
    votes = Votes(
        T_ref_query=jnp.asarray(T[::-1].reshape(-1, 3)),
        row=jnp.asarray(np.repeat(np.arange(4)[::-1], MAXIMA).astype(np.int32)),
        count=jnp.full(4 * MAXIMA, 20, jnp.int32),
        rating=jnp.full(4 * MAXIMA, 0.5, jnp.float32),
        valid=jnp.ones(4 * MAXIMA, bool),
    )
    return votes, index.features, query, index.config.raster


def true_pose(row):
    return oracle.between(PLACES[row], QUERY)


def metres_off(poses, rows):
    pairs = zip(poses, rows, strict=True)
    return np.array([oracle.error(np.asarray(T), true_pose(row))[0] for T, row in pairs])


@pytest.mark.parametrize("passed", [2, 6])
def test_the_right_alternatives_are_kept_and_come_by_reference(scene, passed):
    votes, references, query, raster = scene
    config = ShortlistConfig(passed=passed, kept=2)
    listed = _shortlist(votes, references, query, raster, ALIGNMENT, config)
    assert listed.row.tolist() == [0, 2]
    assert listed.alternatives.valid.all()
    for row, T in zip(listed.row, listed.alternatives.T_ref_query, strict=True):
        distance, angle = oracle.error(np.asarray(T), true_pose(row))
        assert distance < 0.03
        assert angle < 0.03


@pytest.mark.parametrize("passed", [2, 5])
def test_a_glance_passes_so_many_and_the_right_ones_first(scene, passed):
    votes, references, query, raster = scene
    found = _glance_through(votes, references, query, raster, ShortlistConfig(passed=passed))
    assert len(found.row) == passed
    assert sorted(found.row.tolist()[:2]) == [0, 2]
    assert (metres_off(found.T_ref_query, found.row)[:2] < 0.08).all()


def test_a_glance_moves_nothing_and_leaves_nothing_out_where_all_may_pass(scene):
    votes, references, query, raster = scene
    found = _glance_through(votes, references, query, raster, ShortlistConfig(passed=12))
    for passed, given in zip(jax.tree.leaves(found), jax.tree.leaves(votes), strict=True):
        rows = [np.asarray(leaf).reshape(12, -1).tolist() for leaf in (passed, given)]
        assert sorted(rows[0]) == sorted(rows[1])


def test_of_equal_glances_the_one_with_more_votes_passes(scene):
    votes, references, query, raster = scene
    ours = int(np.flatnonzero((votes.row == 0) & (metres_off(votes.T_ref_query, votes.row) < 1))[0])
    copies = jax.tree.map(lambda array: array[np.full(12, ours)], votes)
    rating = jnp.asarray(np.linspace(0.1, 1.0, 12)[::-1].astype(np.float32))
    copies = eqx.tree_at(lambda v: v.rating, copies, rating[np.argsort(np.arange(12) * 5 % 12)])
    found = _glance_through(copies, references, query, raster, ShortlistConfig(passed=2))
    np.testing.assert_array_equal(found.rating, rating[:2])


def test_of_equal_glances_those_at_the_place_more_like_the_query_pass(scene):
    votes, references, query, raster = scene
    rows = np.asarray(votes.row)
    ours = int(np.flatnonzero((rows == 0) & (metres_off(votes.T_ref_query, rows) < 1))[0])
    votes = jax.tree.map(lambda array: array[np.full(12, ours)], votes)
    votes = eqx.tree_at(lambda v: v.row, votes, jnp.asarray(rows))
    blank = jax.tree.map(lambda array: jnp.zeros_like(array) + array[:1], references)
    signature = jnp.zeros_like(blank.signature).at[2].set(query.signature)
    alike = eqx.tree_at(lambda r: r.signature, blank, signature)
    found = _glance_through(votes, alike, query, raster, ShortlistConfig(passed=12))
    there = rows.tolist().count(2)
    assert found.row[:there].tolist() == [2] * there
    off = ShortlistConfig(passed=12, alike=0.0)
    found = _glance_through(votes, alike, query, raster, off)
    assert found.row[:there].tolist() != [2] * there


def test_votes_that_are_not_valid_pass_after_all_others_and_are_not_kept(scene):
    votes, references, query, raster = scene
    at_first = np.flatnonzero(np.asarray(votes.row) == 0)[1]
    votes = eqx.tree_at(lambda v: v.valid, votes, votes.valid.at[at_first].set(False))
    found = _glance_through(votes, references, query, raster, ShortlistConfig(passed=12))
    assert not found.valid[-1]
    assert found.valid[:-1].all()
    listed = _shortlist(
        votes, references, query, raster, ALIGNMENT, ShortlistConfig(passed=6, kept=2)
    )
    assert 2 in listed.row.tolist()
    for row, T in zip(listed.row, listed.alternatives.T_ref_query, strict=True):
        assert row != 0 or oracle.error(np.asarray(T), true_pose(0))[0] > 0.2


def test_a_closer_look_refines_and_counts_the_anchors_that_agree(scene):
    votes, references, query, _ = scene
    true = np.flatnonzero(metres_off(votes.T_ref_query, votes.row) < 0.1)
    passed = jax.tree.map(lambda array: array[true], votes)
    found = _look_closer(passed, references, query, ALIGNMENT, ShortlistConfig(kept=2))
    before = metres_off(passed.T_ref_query, passed.row)
    after = metres_off(found.alternatives.T_ref_query, found.row)
    assert found.row.tolist() == [0, 2]
    assert (after < before[::-1]).all()
    found, graphs, graph = jax.device_get((found, references.graph, query.graph))
    ours = graph.xy[graph.valid.any(axis=1)]
    for row, T, anchors in zip(
        found.row, found.alternatives.T_ref_query, found.alternatives.anchors, strict=True
    ):
        theirs = graphs.xy[row][graphs.valid[row].any(axis=1)]
        cos, sin = np.cos(T[2]), np.sin(T[2])
        moved = ours @ np.array([[cos, sin], [-sin, cos]]) + T[:2]
        gaps = np.linalg.norm(moved[:, None] - theirs[None], axis=-1)
        assert anchors == (gaps.min(axis=1) <= ALIGNMENT.agreement).sum() >= 2


def test_alternatives_with_too_few_agreeing_anchors_are_not_valid(scene):
    votes, references, query, raster = scene
    strict = dataclasses.replace(ALIGNMENT, min_anchors=np.float32(99))
    listed = _shortlist(votes, references, query, raster, strict, ShortlistConfig(passed=6, kept=2))
    assert not listed.alternatives.valid.any()


def test_without_the_cascade_nothing_is_left_out_nor_touched(scene):
    votes, *_ = scene
    aligned = Alternatives(
        T_ref_query=votes.T_ref_query.reshape(4, MAXIMA, 3),
        anchors=jnp.full((4, MAXIMA), 5, jnp.int32),
        votes=jnp.ones((4, MAXIMA), jnp.int32),
        valid=jnp.ones((4, MAXIMA), bool),
    )
    everything = all_alternatives(aligned, jnp.arange(4))
    assert everything.row.tolist() == np.repeat(range(4), 3).tolist()
    np.testing.assert_array_equal(everything.alternatives.T_ref_query, votes.T_ref_query)


def test_equal_scores_go_to_the_first_and_the_best_come_by_reference(scene):
    votes, *_ = scene
    ones = jnp.ones((4, MAXIMA), jnp.int32)
    aligned = Alternatives(votes.T_ref_query.reshape(4, MAXIMA, 3), ones, ones, ones > 0)
    ascending = all_alternatives(aligned, jnp.arange(4))
    assert ascending.best(jnp.full(12, 0.5), 4).row.tolist() == [0, 0, 0, 1]
    descending = all_alternatives(aligned, jnp.arange(4)[::-1])
    assert descending.best(jnp.arange(12.0), 5).row.tolist() == [0, 0, 0, 1, 1]


@pytest.mark.parametrize("name", ["passed", "kept"])
def test_sizes_below_one_are_refused_by_name_and_value(name):
    with pytest.raises(ValueError, match=f"{name}: 0"):
        ShortlistConfig(**{name: 0})
