"""Scans aligned pair by pair from a rough idea of their relative pose.

Recognition is global and sees one scan at a time; a robot that drives knows roughly where it went,
and its scans of one place overlap. Each pair is settled from several starts, since wheels slip
most while turning, and the start whose result agrees best beam by beam wins. Where a place looks
alike from several poses, one that the wheels deny must agree the better.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aprjax.configuration import Packed, threshold
from aprjax.evaluation.congruence import CongruenceConfig, Verdicts, both_ways
from aprjax.evaluation.view import View
from aprjax.numerics import HIGHEST, dot, single_precision, wrap
from aprjax.packing import Packing
from aprjax.refine import RefineConfig, estimate, settle

_SLOTS = 64  # pairs of one call
_PAIR = Packing(tuple(jax.ShapeDtypeStruct(shape, jnp.float32) for shape in ((3,), (3, 3), ())))
"""How what is found of a pair comes to the host: pose, covariance and agreement."""


class AlignConfig(eqx.Module):
    """How pairs are refined and compared."""

    refine: RefineConfig = RefineConfig()
    congruence: CongruenceConfig = CongruenceConfig()
    contradiction: Float[Array, ""] = threshold(1.5, "agreeing beams that one contradiction undoes")
    doubt: Float[Array, ""] = threshold(0.1, "doubtful beams assumed beforehand, a share of hits")
    surprise: Float[Array, ""] = threshold(
        27.0, "squared deviations off what is expected, in all, that make agreement count half"
    )


class Aligned(NamedTuple):
    """Relative poses of pairs of scans, on the host in float64."""

    T_first_second: np.ndarray
    """`(*pairs, 3)` metres, radians."""
    covariance: np.ndarray
    """`(*pairs, 3, 3)`, as `refine.estimate` has it."""
    agreement: np.ndarray
    """`(*pairs,)` in [0, 1]: shares of agreeing beams of both scans, multiplied, and weighed by
    what was expected."""


class Expected(NamedTuple):
    """What is known of the relative poses beforehand."""

    T_first_second: np.ndarray
    """`(pairs, 3)` metres, radians."""
    root: np.ndarray
    """`(pairs, 3, 3)`: W with Wᵀ W the inverse covariance."""


@single_precision()
def align_pairs(
    views: View,
    first: np.ndarray,
    second: np.ndarray,
    starts: np.ndarray,
    weights: np.ndarray,
    config: AlignConfig,
    expected: Expected | None = None,
) -> Aligned:
    """Scans `first` `(pairs,)` and `second` of `views` `(scans,)`, aligned from `starts`.

    `starts` `(pairs, S, 3)` are poses `T_first_second` to begin with; the agreement that is reached
    from each counts `weights` `(S,)`. A result that is not what was `expected` counts the less, by
    Cauchy's weight of how far off it is; so does the agreement that is returned. Compiles once for
    each S and each size of `views`.
    """
    if expected is None:
        expected = Expected(np.zeros((len(first), 3)), np.zeros((len(first), 3, 3)))
    parts = []
    for begin in range(0, len(first), _SLOTS):
        taken = slice(begin, begin + _SLOTS)
        count = len(first[taken])

        def padded(array: np.ndarray, kind: type, taken=taken, count=count) -> np.ndarray:
            whole = np.zeros((_SLOTS, *array.shape[1:]), kind)
            whole[:count] = array[taken]
            return whole

        rows = padded(np.stack([first, second], axis=1), np.int32)
        poses = [padded(array, np.float32) for array in (starts, *expected)]
        weighed = np.asarray(weights, np.float32)
        found = _align(views, rows, *poses, weighed, np.int32(count), config)
        parts.append([np.asarray(array, float)[:count] for array in jax.device_get(found)])
    if not parts:
        return Aligned(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    return Aligned(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


@single_precision()
def align_two(first: View, second: View, starts: np.ndarray, rules: Packed[AlignConfig]) -> Aligned:
    """One pair of scans, aligned from `starts` `(S, 3)`, of which none counts more than another.

    `align_pairs` for one pair at a time: views that are on the device stay there. Compiles once
    for each S and each size of the views. The result has no axis of pairs.
    """
    words = np.asarray(_align_two(first, second, np.asarray(starts, np.float32), rules))
    return Aligned(*(np.asarray(array, float) for array in _PAIR.unpack(words[0])))


@jax.jit
def _align(
    views: View,
    rows: Int[Array, "slots 2"],
    starts: Float[Array, "slots starts 3"],
    T_expected: Float[Array, "slots 3"],
    root: Float[Array, "slots 3 3"],
    weights: Float[Array, " starts"],
    count: Int[Array, ""],
    config: AlignConfig,
) -> tuple[Float[Array, "slots 3"], Float[Array, "slots 3 3"], Float[Array, " slots"]]:
    """Pair after pair, which on a CPU keeps what one needs in the cache."""

    def one(index, results):
        first, second = (jax.tree.map(lambda a: a[rows[index, k]], views) for k in range(2))  # noqa: B023
        expected = T_expected[index], root[index]
        found = _align_one(first, second, starts[index], weights, *expected, config)
        return jax.tree.map(lambda all_, new: all_.at[index].set(new), results, found)

    slots = rows.shape[0]
    empty = jnp.zeros((slots, 3)), jnp.zeros((slots, 3, 3)), jnp.zeros(slots)
    return jax.lax.fori_loop(0, count, one, empty)


@jax.jit
def _align_two(
    first: View, second: View, starts: Float[Array, "starts 3"], rules: Packed[AlignConfig]
) -> Int[Array, "1 words"]:
    """One pair by itself, of which nothing is expected."""
    alike, nothing = jnp.ones(len(starts)), (jnp.zeros(3), jnp.zeros((3, 3)))
    found = _align_one(first, second, starts, alike, *nothing, rules.config)
    return _PAIR.pack(jax.tree.map(lambda array: array[None], found))


def _align_one(
    first: View,
    second: View,
    starts: Float[Array, "starts 3"],
    weights: Float[Array, " starts"],
    T_expected: Float[Array, "3"],
    root: Float[Array, "3 3"],
    config: AlignConfig,
) -> tuple[Float[Array, "3"], Float[Array, "3 3"], Float[Array, ""]]:
    """The pose, its covariance and the agreement of one pair."""

    def attempt(start):
        T = settle(first, second, start, config.refine)
        ahead, back = both_ways(first, second, T, config.congruence)
        gap = T - T_expected
        off = jnp.matmul(root, gap.at[2].set(wrap(gap[2])), precision=HIGHEST)
        weight = 1.0 / (1.0 + dot(off, off) / config.surprise)
        return T, weight * _share(ahead, config) * _share(back, config)

    poses, agreement = jax.vmap(attempt)(starts)
    best = jnp.argmax(weights * agreement)
    refined = estimate(first, second, poses[best], config.refine)
    return refined.T_ref_query, refined.covariance, agreement[best]


def _share(verdicts: Verdicts, config: AlignConfig) -> Float[Array, ""]:
    against = config.contradiction * verdicts.contradict + config.doubt * verdicts.hits
    return verdicts.agree / jnp.maximum(verdicts.agree + against, 1.0)
