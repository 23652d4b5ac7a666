import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.alignment.align import Alternatives
from aprjax.references import ReferenceSet
from aprjax.shortlist import ShortlistConfig, all_alternatives, shortlist
from tests.oracles import evaluation as oracle
from tests.worlds import office, scan_at

MAXIMA = 3
QUERY = np.array([12.4, 0.1, 0.2])
PLACES = np.array([[12.0, 0.0, 0.3], [6.0, 0.2, 0.0], [13.0, -0.2, 0.1], [18.0, 0.0, 2.0]])


@pytest.fixture(scope="module")
def scene():
    """Views of four places and of a query, and three alternatives each, the true one among them."""
    world = office(seed=3)
    scans = [scan_at(world, pose) for pose in (*PLACES, QUERY)]
    view = ReferenceSet.build(scans).index.features.view
    query = jax.tree.map(lambda array: array[4], view)
    rng = np.random.default_rng(0)
    T = rng.uniform(-2, 2, (4, MAXIMA, 3)).astype(np.float32)
    for row in (0, 2):
        T[row, 1] = oracle.between(PLACES[row], QUERY) + np.array([0.05, -0.05, 0.02])
    aligned = Alternatives(
        T_ref_query=jnp.asarray(T),
        anchors=jnp.full((4, MAXIMA), 5, jnp.int32),
        votes=jnp.ones((4, MAXIMA), jnp.int32),
        valid=jnp.ones((4, MAXIMA), bool),
    )
    return view, query, aligned


@pytest.mark.parametrize("passed", [2, 6])
def test_the_right_alternatives_are_kept_and_come_by_reference(scene, passed):
    view, query, aligned = scene
    config = ShortlistConfig(passed=passed, kept=2)
    listed = shortlist(aligned, jnp.arange(4), view, query, config)
    assert listed.row.tolist() == [0, 2]
    for row, T in zip(listed.row, listed.alternatives.T_ref_query, strict=True):
        distance, angle = oracle.error(np.asarray(T), oracle.between(PLACES[row], QUERY))
        assert distance < (0.08 if passed == 2 else 0.03)
        assert angle < 0.03


def test_alternatives_that_are_not_valid_are_not_kept(scene):
    view, query, aligned = scene
    aligned = eqx.tree_at(lambda a: a.valid, aligned, aligned.valid.at[0, 1].set(False))
    listed = shortlist(aligned, jnp.arange(4), view, query, ShortlistConfig(passed=4, kept=3))
    true = oracle.between(PLACES[0], QUERY)
    assert 2 in listed.row.tolist()
    for row, T in zip(listed.row, listed.alternatives.T_ref_query, strict=True):
        assert row != 0 or oracle.error(np.asarray(T), true)[0] > 0.2


def test_where_everything_fits_nothing_is_left_out_nor_touched(scene):
    view, query, aligned = scene
    listed = shortlist(aligned, jnp.arange(4), view, query, ShortlistConfig(kept=12))
    everything = all_alternatives(aligned, jnp.arange(4))
    assert listed.row.tolist() == everything.row.tolist() == np.repeat(range(4), 3).tolist()
    np.testing.assert_array_equal(
        listed.alternatives.T_ref_query, aligned.T_ref_query.reshape(-1, 3)
    )


def test_equal_scores_go_to_the_lowest_reference(scene):
    *_, aligned = scene
    everything = all_alternatives(aligned, jnp.arange(4))
    best = everything.best(jnp.full(12, 0.5), 4)
    assert best.row.tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize("name", ["passed", "kept"])
def test_sizes_below_one_are_refused_by_name_and_value(name):
    with pytest.raises(ValueError, match=f"{name}: 0"):
        ShortlistConfig(**{name: 0})
