"""Matching many scans: on the host, in batches that fill the device and bound its memory."""

from collections.abc import Sequence
from functools import cache

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Int

from aprjax.calls import in_calls, rows_of, size_of_calls
from aprjax.configuration import Packed, check_kind
from aprjax.describing import describe_chunk
from aprjax.features import Features
from aprjax.matcher import MatchConfig, match_described
from aprjax.numerics import bucket
from aprjax.programs import Program
from aprjax.references import ReferenceIndex, ReferenceSet, check_references, checked_ids
from aprjax.result import MatchResult, result_packing
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
    config, rules = checked_config(config)
    words = _matched([scan], references, config.chunk, rules, ids[None])
    return result_packing(config.hypotheses).unpack(words[0])


def match_batch(
    scans: Sequence[Scan] | Scan,
    references: ReferenceSet,
    config: MatchConfig | None = None,
    *,
    exclude: np.ndarray | None = None,
) -> MatchResult:
    """Where each scan was taken, with respect to every reference, by jitted calls.

    On a CPU they are shared among its cores: `MatchConfig.chunk` scans a call where there are so
    many for each core, else one. `scans` is a list of scans or a stacked `Scan`; the result has a
    leading axis of that length and lies on the host. `exclude` `(queries, any)` are ids of
    references that must not answer a query, as the scans taken just before it in a search for
    closed loops; -1 stands for none. For each bucket of beams, of references and of ids to exclude
    (see `numerics.bucket`) there are two programs, of one query and of a chunk, whatever the
    thresholds; on an accelerator also those of smaller chunks. What describes so many scans at a
    time is shared with `ReferenceSet.build`. Raises `ValueError` for an empty list, for no
    references, and naming what is no scan, no id, no `ReferenceSet` or no `MatchConfig`; a scan in
    which nothing can be found is no error but a status.
    """
    config, rules = checked_config(config)
    words = _matched(scans, references, config.chunk, rules, exclude)
    return result_packing(config.hypotheses).unpack(words)


def _matched(
    scans: Sequence[Scan] | Scan,
    references: ReferenceSet,
    chunk: int,
    rules: Packed[MatchConfig],
    exclude: np.ndarray | None,
) -> np.ndarray:
    """`MatchResult`s of all scans as `Packing.pack` leaves them `(queries, words)`."""
    check_references(references, ReferenceSet)
    batch, excluded = checked_queries(scans, exclude)
    queries = len(excluded)
    chunk = size_of_calls(queries, chunk)
    together = jax.default_backend() != "cpu"

    def work(start: int) -> np.ndarray:
        rows = slice(start, start + chunk)
        ids = excluded[rows]
        missing = chunk - len(ids)
        # On an instance, Equinox would first make a module of the method.
        scans = Scan.pad_batch(rows_of(batch, rows), chunk)
        found = _match_program(
            describe_chunk(scans, references.index.described_by),
            np.pad(ids, [(0, missing), (0, 0)], constant_values=-1) if missing else ids,
            references.index,
            rules,
            together=together,
        )
        return np.asarray(found.words)[: len(ids)]

    return np.concatenate(in_calls(work, queries, chunk))


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


def checked_config(config: MatchConfig | None) -> tuple[MatchConfig, Packed[MatchConfig]]:
    """The configuration or the defaults, as it is and as programs are given it.

    Raises `ValueError` for one of another kind, and as `Packed.of`.
    """
    if config is None:
        return _defaults()
    check_kind("config", config, MatchConfig)
    return config, Packed.of(config)


@cache
def _defaults() -> tuple[MatchConfig, Packed[MatchConfig]]:
    """Made once: that takes a fifth of what the host does for a single query."""
    config = MatchConfig()
    return config, Packed.of(config)


class _Words(eqx.Module):
    """`MatchResult`s as `Packing.pack` leaves them; a `Program` returns a module."""

    words: Int[Array, "chunk words"]


def _match_chunk(
    queries: Features,
    excluded: Int[Array, "chunk any"],
    references: ReferenceIndex,
    rules: Packed[MatchConfig],
    together: bool,
) -> _Words:
    """As many queries as bound the memory, aligned and evaluated `together` or one by one.

    On a CPU they follow each other: what one query needs then stays in the cache.
    """
    config = rules.config
    found = match_described(queries, excluded, references, config, together)
    return _Words(result_packing(config.hypotheses).pack(found))


_match_program = Program(_match_chunk, _Words, static=("together",))
