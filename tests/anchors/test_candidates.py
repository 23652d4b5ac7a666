import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.anchors.candidates import Candidates, Kind

best = jax.jit(Candidates.best, static_argnums=1)


def candidates(xy, salience, valid=None):
    xy = np.asarray(xy, np.float32).reshape(-1, 2)
    return Candidates(
        xy=jnp.asarray(xy),
        kind=jnp.arange(len(xy), dtype=jnp.int32) % 3,
        salience=jnp.asarray(salience, jnp.float32),
        valid=jnp.ones(len(xy), bool) if valid is None else jnp.asarray(valid),
    )


def greedy(xy, salience, valid, size, apart):
    """Indices chosen one by one, and whether any is left."""
    left, chosen = {i for i in range(len(xy)) if valid[i]}, []
    while left and len(chosen) < size:
        pick = max(left, key=lambda i: (salience[i], -i))
        chosen.append(pick)
        left = {i for i in left if np.hypot(*(xy[i] - xy[pick])) >= apart}
    return chosen, bool(left)


@pytest.mark.parametrize("size", [1, 8, 40])
@pytest.mark.parametrize("seed", range(3))
def test_the_choice_equals_the_greedy_loop(seed, size):
    rng = np.random.default_rng(seed)
    xy, salience = rng.uniform(-2, 2, (40, 2)).astype(np.float32), rng.random(40)
    valid = rng.random(40) < 0.8
    picked, overflow = best(candidates(xy, salience, valid), size, jnp.float32(0.5))
    chosen, left = greedy(xy, np.float32(salience), valid, size, 0.5)
    assert int(picked.valid.sum()) == len(chosen)
    np.testing.assert_array_equal(picked.xy[: len(chosen)], xy[chosen])
    np.testing.assert_array_equal(picked.kind[: len(chosen)], np.array(chosen) % 3)
    assert (int(overflow) > 0) == left


def test_the_choice_among_hundreds_equals_the_greedy_loop():
    rng = np.random.default_rng(3)
    corners = rng.uniform(-8, 8, (25, 2))
    xy = (corners[rng.integers(25, size=1000)] + rng.normal(0, 0.05, (1000, 2))).astype(np.float32)
    salience, valid = rng.random(1000), np.arange(1000) % 2 == 0
    picked, overflow = best(candidates(xy, salience, valid), 16, jnp.float32(0.5))
    chosen, left = greedy(xy, np.float32(salience), valid, 16, 0.5)
    np.testing.assert_array_equal(picked.xy, xy[chosen])
    assert (int(overflow) > 0) == left


def test_the_chosen_are_most_salient_first_and_apart():
    rng = np.random.default_rng(4)
    picked, _ = best(candidates(rng.uniform(-1, 1, (60, 2)), rng.random(60)), 12, jnp.float32(0.4))
    real = np.asarray(picked.valid)
    xy, salience = np.asarray(picked.xy)[real], np.asarray(picked.salience)[real]
    assert (np.diff(salience) <= 0).all()
    gaps = np.linalg.norm(xy[:, None] - xy, axis=-1)[~np.eye(len(xy), dtype=bool)]
    assert gaps.min() >= 0.4


def test_what_does_not_fit_is_counted_and_the_most_salient_stay():
    points = candidates([(x, 0) for x in range(6)], [1, 5, 3, 6, 2, 4])
    picked, overflow = best(points, 4, jnp.float32(0.25))
    assert np.asarray(picked.xy)[:, 0].tolist() == [3, 1, 5, 2]
    assert int(overflow) == 2
    assert int(best(points, 6, jnp.float32(0.25))[1]) == 0


def test_overflow_counts_distinct_points_not_each_sighting_of_one():
    """Ten candidates for the one corner that did not fit are one anchor too few."""
    xy = [(0, 0), *[(5, 0.01 * k) for k in range(10)]]
    _, overflow = best(candidates(xy, np.linspace(1, 0.1, 11)), 1, jnp.float32(0.25))
    assert int(overflow) == 1


def test_duplicates_are_one_point():
    picked, overflow = best(
        candidates([(1, 1)] * 5, [0.1, 0.9, 0.3, 0.9, 0.2]), 3, jnp.float32(0.25)
    )
    assert int(picked.valid.sum()) == 1
    assert int(picked.kind[0]) == 1
    assert int(overflow) == 0


@pytest.mark.usefixtures("nans")
@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_candidates_fill_the_rest_with_invalid_ones(count):
    valid = np.arange(5) < count
    xy = np.where(valid[:, None], np.arange(10).reshape(5, 2), np.nan)
    salience = np.where(valid, 1.0, np.nan)
    picked, overflow = best(candidates(xy, salience, valid), 4, jnp.float32(0.25))
    assert np.asarray(picked.valid).tolist() == [k < count for k in range(4)]
    assert int(overflow) == 0


def test_joined_candidates_are_all_there():
    first, second = candidates([(0, 0)], [1.0]), candidates([(1, 1), (2, 2)], [2.0, 3.0])
    joined = Candidates.join(first, second)
    np.testing.assert_array_equal(joined.salience, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(joined.xy[1:], second.xy)


def test_the_kinds_are_those_of_the_paper():
    assert [kind.name for kind in Kind] == ["JUMP_EDGE", "ANGLE", "VIRTUAL_EDGE"]
