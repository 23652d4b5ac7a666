"""Matching many scans: on the host, in batches that fill the device and bound its memory."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aprjax.configuration import check_kind, check_single
from aprjax.matcher import MatchConfig, MatchResult, match_together, result_shapes
from aprjax.numerics import bucket, single_precision
from aprjax.packing import pack, unpack, width
from aprjax.programs import Program
from aprjax.references import ReferenceIndex, ReferenceSet, check_references, checked_ids
from aprjax.scan import Scan, as_stack


def match(
    scan: Scan,
    references: ReferenceSet,
    config: MatchConfig | None = None,
    *,
    exclude: Sequence[int] | np.ndarray = (),
) -> MatchResult:
    """Where one scan was taken, with respect to every reference whose id is not in `exclude`.

    `match_batch` without the leading axis.
    """
    ids = checked_ids("exclude", exclude)
    result = match_batch([scan], references, config, exclude=ids[None])
    return jax.tree.map(lambda array: array[0], result)


def match_batch(
    scans: Sequence[Scan] | Scan,
    references: ReferenceSet,
    config: MatchConfig | None = None,
    *,
    exclude: np.ndarray | None = None,
) -> MatchResult:
    """Where each scan was taken, with respect to every reference, by jitted calls.

    On a CPU, a batch of several chunks is shared among its cores, one call for each.
    `scans` is a list of scans or a stacked `Scan`; the result has a leading axis of that length
    and lies on the host. `exclude` `(queries, any)` are ids of references that must not answer a
    query, as the scans taken just before it in a search for closed loops; -1 stands for none. The
    call compiles once for each bucket of beams, of references, of queries and of ids to exclude
    (see `numerics.bucket`), whatever the thresholds. Raises `ValueError` for an empty list, for no
    references, and naming what is no scan, no id, no `ReferenceSet` or no `MatchConfig`; a scan in
    which nothing can be found is no error but a status.
    """
    config = checked_config(config)
    check_references(references, ReferenceSet)
    batch, excluded = checked_queries(scans, exclude)
    queries = len(excluded)
    on_cpu = jax.default_backend() == "cpu"
    cores = (os.cpu_count() or 1) if on_cpu else 1
    workers = min(cores, max(queries // config.chunk, 1))
    part = -(-queries // workers)
    chunk = min(config.chunk, 1 << (part - 1).bit_length())
    slots = -(-bucket(part, smallest=1) // chunk) * chunk
    thresholds, rules = flat_thresholds(config)

    def work(start: int) -> np.ndarray:
        here = jax.tree.map(lambda array: np.asarray(array)[start : start + part], batch)
        count = here.ranges.shape[0]
        ids = np.zeros((slots, excluded.shape[1]), np.int32)
        ids[:count] = excluded[start : start + part]
        # A setting of the thread, of which each has its own.
        with single_precision():
            found = _match_program(
                # On an instance, Equinox would first make a module of the method.
                Scan.pad_batch(here, slots),
                ids,
                np.int32(count),
                references.index,
                thresholds,
                rules=rules,
                chunk=chunk,
                together=not on_cpu,
            )
            return np.asarray(found.words)[:count]

    starts = range(0, queries, part)
    if len(starts) == 1:
        words = work(0)
    else:
        # XLA runs the calls of one thread one after another, those of several at the same time.
        with ThreadPoolExecutor(workers) as pool:
            words = np.concatenate(list(pool.map(work, starts)))
    return unpack(words, result_shapes(config.hypotheses))


def checked_queries(
    scans: Sequence[Scan] | Scan, exclude: np.ndarray | None
) -> tuple[Scan, np.ndarray]:
    """Stacked scans `(queries, slots)` and the ids they exclude `(queries, bucket)`, else -1."""
    batch = as_stack(scans, "queries")
    queries = batch.ranges.shape[0]
    ids = np.empty((queries, 0), np.int32) if exclude is None else checked_ids("exclude", exclude)
    if ids.ndim != 2 or len(ids) != queries:
        raise ValueError(f"exclude: shape {ids.shape} is not ({queries}, any)")
    excluded = np.full((queries, bucket(ids.shape[1])), -1, np.int32)
    excluded[:, : ids.shape[1]] = ids
    return batch, excluded


def checked_config(config: MatchConfig | None) -> MatchConfig:
    """The configuration or the defaults.

    Raises `ValueError` for one of another kind, and naming a threshold that is several numbers.
    """
    if config is None:
        return _defaults()
    check_kind("config", config, MatchConfig)
    check_single(config)
    return config


@cache
def _defaults() -> MatchConfig:
    """Made once: that takes a tenth of what the host does for a single query."""
    return MatchConfig()


def flat_thresholds(config: MatchConfig) -> tuple[np.ndarray, Any]:
    """All thresholds in one array, which goes to the device at once, and their structure."""
    return _default_thresholds() if config is _defaults() else _flat(config)


@cache
def _default_thresholds() -> tuple[np.ndarray, Any]:
    """Made once: that takes as long again as the defaults do."""
    thresholds, rules = _flat(_defaults())
    thresholds.setflags(write=False)
    return thresholds, rules


def _flat(config: MatchConfig) -> tuple[np.ndarray, Any]:
    thresholds, rules = jax.tree.flatten(config)
    return np.array(thresholds, np.float32), rules


_traced_once = jax.jit(match_together, static_argnames="together")
"""`match_together`, whose trace serves every number of slots: chunks are of one size."""


class _Words(eqx.Module):
    """`MatchResult`s as `pack` leaves them; a `Program` returns a module."""

    words: Int[Array, "slots words"]


def _match_chunks(
    scans: Scan,
    excluded: Int[Array, "slots any"],
    queries: Int[Array, ""],
    references: ReferenceIndex,
    thresholds: Float[Array, " thresholds"],
    rules: Any,
    chunk: int,
    together: bool,
) -> _Words:
    """`chunk` queries at a time, so that memory does not grow with the batch.

    Those of one chunk are aligned and evaluated `together`, or one after the other: on a CPU
    what one query needs then stays in the cache. The number of rounds is traced: padding up to
    the bucket costs no time.
    """
    config = jax.tree.unflatten(rules, list(thresholds))

    def work(index: Array, words: Array) -> Array:
        here, ids = jax.tree.map(
            lambda a: jax.lax.dynamic_slice_in_dim(a, index * chunk, chunk), (scans, excluded)
        )
        found = pack(_traced_once(here, ids, references, config, together), like)
        return jax.lax.dynamic_update_slice_in_dim(words, found, index * chunk, 0)

    like = result_shapes(config.hypotheses)
    empty = jnp.zeros((scans.ranges.shape[0], width(like)), jnp.int32)
    return _Words(jax.lax.fori_loop(0, (queries + chunk - 1) // chunk, work, empty))


_match_program = Program(_match_chunks, _Words, static=("rules", "chunk", "together"))
