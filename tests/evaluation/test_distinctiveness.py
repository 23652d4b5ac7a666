import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.evaluation.congruence import CongruenceConfig
from aprjax.evaluation.distinctiveness import (
    DistinctivenessConfig,
    Placement,
    distinct_quality,
    rivalry,
)
from aprjax.references import ReferenceSet
from tests.oracles import evaluation as oracle
from tests.worlds import office, scan_at

RULES = DistinctivenessConfig()
HERE, THERE = np.array([12.0, 0.0, 0.3]), np.array([12.8, 0.3, 0.1])
QUERY = np.array([12.4, 0.1, 0.2])


@pytest.fixture(scope="module")
def views():
    world = office(seed=3)
    return ReferenceSet.build([scan_at(world, pose) for pose in (HERE, THERE)]).index.features.view


@jax.jit
def _rivalry(best, other, T_best_query, T_other_query, views, placement):
    config = CongruenceConfig()
    return rivalry(best, other, T_best_query, T_other_query, views, placement, config, RULES)


def between(best, other, T_best_query, T_other_query, views, known=(False, False)):
    poses = (jnp.asarray(T, jnp.float32) for T in (T_best_query, T_other_query))
    placement = Placement(jnp.asarray([HERE, THERE], jnp.float32), jnp.asarray(known))
    return float(_rivalry(jnp.int32(best), jnp.int32(other), *poses, views, placement))


def test_two_references_of_one_place_are_no_rivals(views):
    T_here, T_there = oracle.between(HERE, QUERY), oracle.between(THERE, QUERY)
    assert between(0, 1, T_here, T_there, views) == 0
    assert between(1, 0, T_there, T_here, views) == 0


@pytest.mark.parametrize("offset", [(2.0, 0.0, 0.0), (0.0, 0.0, np.pi / 2), (-1.0, 1.0, 0.5)])
def test_references_that_contradict_each_other_are_rivals(views, offset):
    T_here = oracle.between(HERE, QUERY)
    wrong = oracle.compose(oracle.between(THERE, QUERY), np.array(offset))
    assert between(0, 1, T_here, wrong, views) == 1


def test_two_poses_in_one_reference_are_one_or_rivals(views):
    T = oracle.between(HERE, QUERY)
    assert between(0, 0, T, T + np.array([0.1, 0, 0.05]), views) == 0
    assert between(0, 0, T, T + np.array([0.5, 0, 0.0]), views) == 1
    assert between(0, 0, T, T + np.array([0.0, 0, 0.3]), views) == 1


def test_where_both_poses_are_known_they_decide_whatever_the_scans_show(views):
    blank = jax.tree.map(jnp.zeros_like, views)
    blank = eqx.tree_at(lambda v: v.angle_increment, blank, views.angle_increment)
    T_here, T_there = oracle.between(HERE, QUERY), oracle.between(THERE, QUERY)
    wrong = oracle.compose(T_there, np.array([1.0, 0.0, 0.0]))
    assert between(0, 1, T_here, wrong, blank) == 0
    assert between(0, 1, T_here, wrong, blank, (True, True)) == 1
    assert between(0, 1, T_here, T_there, blank, (True, True)) == 0
    for known in ((True, False), (False, True)):
        assert between(0, 1, T_here, wrong, blank, known) == 0


def test_without_rivals_qualities_stay_as_they_are():
    e_m = jnp.asarray([0.5, 0.4, 0.1, 0.0])
    quality, strongest = distinct_quality(e_m, jnp.zeros(4), RULES)
    np.testing.assert_array_equal(quality, e_m)
    assert strongest == 0


def test_a_rival_costs_the_best_half_of_its_own_e_m():
    e_m = jnp.asarray([0.5, 0.45, 0.3, 0.0])
    quality, strongest = distinct_quality(e_m, jnp.asarray([0.0, 0.0, 1.0, 1.0]), RULES)
    np.testing.assert_allclose(quality, [0.5 - 0.15, 0.45 - 0.15, 0.15, 0.0], rtol=1e-6)
    np.testing.assert_allclose(strongest, 0.3, rtol=1e-6)


def test_the_best_stays_the_best_and_all_stay_in_range():
    rng = np.random.default_rng(0)
    for _ in range(100):
        e_m = np.sort(rng.uniform(0, 1, 8).astype(np.float32))[::-1]
        excluding = np.r_[0, rng.choice([0, 0.3, 1], 7)].astype(np.float32)
        quality, _ = distinct_quality(jnp.asarray(e_m), jnp.asarray(excluding), RULES)
        assert int(jnp.argmax(quality)) == 0
        assert np.all((quality >= 0) & (quality <= e_m))


def test_alternatives_beyond_the_rivals_take_nothing_from_those_before_them():
    rng = np.random.default_rng(1)
    more = RULES.rivals + 8
    e_m = np.sort(rng.uniform(0.1, 1, more).astype(np.float32))[::-1].copy()
    excluding = np.r_[0, rng.choice([0, 0.3], more - 1)].astype(np.float32)
    excluding[RULES.rivals :] = 1
    all_, strongest = distinct_quality(jnp.asarray(e_m), jnp.asarray(excluding), RULES)
    few, wanted = distinct_quality(
        *(jnp.asarray(a[: RULES.rivals]) for a in (e_m, excluding)), RULES
    )
    np.testing.assert_array_equal(all_[: RULES.rivals], few)
    assert strongest == wanted
    # They lose to the best themselves.
    np.testing.assert_allclose(all_[RULES.rivals :], 0.5 * e_m[RULES.rivals :], rtol=1e-6)


def test_without_weight_rivals_cost_nothing():
    e_m = jnp.asarray([0.5, 0.4])
    quality, strongest = distinct_quality(
        e_m, jnp.asarray([0.0, 1.0]), DistinctivenessConfig(weight=0.0)
    )
    np.testing.assert_array_equal(quality, e_m)
    np.testing.assert_allclose(strongest, 0.4)
