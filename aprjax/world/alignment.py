"""Scans aligned pair by pair from a rough idea of their relative pose.

Recognition is global and sees one scan at a time; a robot that drives knows roughly where it went,
and its scans of one place overlap. Each pair is settled from several starts, since wheels slip
most while turning, and the start whose result agrees best beam by beam wins.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aprjax.configuration import threshold
from aprjax.evaluation.congruence import CongruenceConfig, Verdicts, congruence
from aprjax.evaluation.view import View
from aprjax.refine import RefineConfig, estimate, settle
from aprjax.se2 import inverse

_SLOTS = 64  # pairs of one call


class AlignConfig(eqx.Module):
    """How pairs are refined and compared."""

    refine: RefineConfig = RefineConfig()
    congruence: CongruenceConfig = CongruenceConfig()
    contradiction: Float[Array, ""] = threshold(1.5, "agreeing beams that one contradiction undoes")
    doubt: Float[Array, ""] = threshold(0.1, "doubtful beams assumed beforehand, a share of hits")


class Aligned(NamedTuple):
    """Relative poses of pairs of scans, on the host in float64."""

    T_first_second: np.ndarray
    """`(pairs, 3)` metres, radians."""
    covariance: np.ndarray
    """`(pairs, 3, 3)`, as `refine.estimate` has it."""
    agreement: np.ndarray
    """`(pairs,)` in [0, 1]: shares of agreeing beams of both scans, multiplied."""


def align_pairs(
    views: View,
    first: np.ndarray,
    second: np.ndarray,
    starts: np.ndarray,
    weights: np.ndarray,
    config: AlignConfig,
) -> Aligned:
    """Scans `first` `(pairs,)` and `second` of `views` `(scans,)`, aligned from `starts`.

    `starts` `(pairs, S, 3)` are poses `T_first_second` to begin with; the agreement that is reached
    from each counts `weights` `(S,)`. Compiles once for each S and each size of `views`.
    """
    parts = []
    for begin in range(0, len(first), _SLOTS):
        count = min(_SLOTS, len(first) - begin)
        taken = slice(begin, begin + count)
        padded = np.zeros((_SLOTS, *starts.shape[1:]), np.float32)
        padded[:count] = starts[taken]
        rows = np.zeros((2, _SLOTS), np.int32)
        rows[:, :count] = first[taken], second[taken]
        weighed = np.asarray(weights, np.float32)
        found = _align(views, rows, padded, weighed, np.int32(count), config)
        parts.append([np.asarray(array, float)[:count] for array in jax.device_get(found)])
    if not parts:
        return Aligned(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    return Aligned(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


@partial(jax.jit)
def _align(
    views: View,
    rows: Int[Array, "2 slots"],
    starts: Float[Array, "slots starts 3"],
    weights: Float[Array, " starts"],
    count: Int[Array, ""],
    config: AlignConfig,
) -> tuple[Float[Array, "slots 3"], Float[Array, "slots 3 3"], Float[Array, " slots"]]:
    """Pair after pair, which on a CPU keeps what one needs in the cache."""

    def one(index, results):
        first, second = (jax.tree.map(lambda a: a[rows[k, index]], views) for k in range(2))  # noqa: B023

        def attempt(start):
            T = settle(first, second, start, config.refine)
            ahead = congruence(first, second, inverse(T), config.congruence)
            back = congruence(second, first, T, config.congruence)
            return T, _share(ahead, config) * _share(back, config)

        poses, agreement = jax.vmap(attempt)(starts[index])
        best = jnp.argmax(weights * agreement)
        refined = estimate(first, second, poses[best], config.refine)
        found = refined.T_ref_query, refined.covariance, agreement[best]
        return jax.tree.map(lambda all_, new: all_.at[index].set(new), results, found)

    slots = rows.shape[1]
    empty = jnp.zeros((slots, 3)), jnp.zeros((slots, 3, 3)), jnp.zeros(slots)
    return jax.lax.fori_loop(0, count, one, empty)


def _share(verdicts: Verdicts, config: AlignConfig) -> Float[Array, ""]:
    against = config.contradiction * verdicts.contradict + config.doubt * verdicts.hits
    return verdicts.agree / jnp.maximum(verdicts.agree + against, 1.0)
