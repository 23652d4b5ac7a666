"""Matching with a catalogue: the references most like the query, each described anew."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aprjax.batch import checked_config, checked_queries
from aprjax.calls import rows_of
from aprjax.catalogue.catalogue import BLOCK, Catalogue
from aprjax.configuration import Packed, check_kind
from aprjax.evaluation.distinctiveness import Placement
from aprjax.features import FeatureConfig, describe
from aprjax.matcher import MatchConfig, match_one
from aprjax.numerics import HIGHEST, bucket, single_precision
from aprjax.programs import Program
from aprjax.references import ReferenceIndex
from aprjax.relations.edge_table import EdgeTable
from aprjax.relations.histograms import preselection_quality
from aprjax.result import MatchResult
from aprjax.scan import Scan

LIKELY = 64
"""References that are described and matched, by default."""
_NONE = np.float32(-2.0)  # less than any likeness
_CHUNK = 8  # queries whose references are described at a time, which bounds the memory
_AT_ONCE = 256  # queries whose signatures are compared at a time, which bounds the memory


def most_alike(
    scans: Scan, catalogue: Catalogue, count: int = LIKELY, *, exclude: np.ndarray | None = None
) -> Int[np.ndarray, "queries count"]:
    """Ids of the references whose signatures are most like those of stacked scans, best first.

    Equals are in the order of their ids; -1 where there are no more. `exclude` as in
    `match_catalogue`.
    """
    batch, excluded = checked_queries(scans, exclude)
    signatures = catalogue.signatures(batch.pad(max(catalogue.slots, batch.ranges.shape[-1])))
    slots = bucket(len(signatures), smallest=1)
    padding = [(0, slots - len(signatures)), (0, 0)]
    excluded = np.pad(excluded, padding, constant_values=-1)
    signatures, excluded = jax.device_put((np.pad(signatures, padding), excluded))
    likeness = np.full((slots, count), _NONE, np.float32)
    best = np.full((slots, count), -1, np.int32)
    with single_precision():
        for number, block in enumerate(catalogue.blocks):
            first, size = np.int32(number * BLOCK), np.int32(len(block))
            likeness, best = _more_alike(
                signatures, excluded, block.signatures, first, size, likeness, best
            )
    found = np.asarray(best)[: batch.ranges.shape[0]]
    return np.where(np.asarray(likeness)[: len(found)] > _NONE, found, -1)


@jax.jit
def _more_alike(
    queries: Float[Array, "queries size"],
    excluded: Int[Array, "queries any"],
    block: Float[Array, "block size"],
    first: Int[Array, ""],
    count: Int[Array, ""],
    likeness: Float[Array, "queries best"],
    best: Int[Array, "queries best"],
) -> tuple[Float[Array, "queries best"], Int[Array, "queries best"]]:
    """The best after those of another block, which begins with the reference `first`."""
    product = jnp.matmul(queries, block.T, precision=HIGHEST)
    ids = first + jnp.arange(block.shape[0], dtype=jnp.int32)
    product = jnp.where((ids < first + count)[None, :], product, _NONE)
    at = jnp.where(excluded >= first, excluded - first, block.shape[0])
    product = product.at[jnp.arange(at.shape[0])[:, None], at].set(_NONE, mode="drop")
    here, index = jax.lax.top_k(product, min(best.shape[1], block.shape[0]))
    likeness = jnp.concatenate([likeness, here], axis=1)
    best_ids = jnp.concatenate([best, first + index], axis=1)
    likeness, index = jax.lax.top_k(likeness, best.shape[1])
    return likeness, jnp.take_along_axis(best_ids, index, axis=1)


def match_catalogue(
    scans: Sequence[Scan] | Scan,
    catalogue: Catalogue,
    config: MatchConfig | None = None,
    *,
    exclude: np.ndarray | None = None,
    likely: int = LIKELY,
) -> MatchResult:
    """Where each scan was taken, with respect to the `likely` references that are most like it.

    Arguments, result and errors are those of `aprjax.match_batch`; references are told by their
    ids in the catalogue. Memory beyond the catalogue does not grow with it, nor with the number of
    scans beyond a few hundred.
    """
    config, rules = checked_config(config)
    check_kind("catalogue", catalogue, Catalogue)
    if len(catalogue) == 0:
        raise ValueError("catalogue: it is empty")
    if likely < 1:
        raise ValueError(f"likely: {likely} is not a positive number")
    batch, excluded = checked_queries(scans, exclude)
    queries = len(excluded)
    chunk = min(config.chunk, _CHUNK, 1 << (queries - 1).bit_length())
    likely = min(likely, bucket(len(catalogue)))
    described_by = Packed.of(catalogue.config)
    on_cpu = jax.default_backend() == "cpu"
    alike = np.concatenate(
        [
            most_alike(rows_of(batch, rows), catalogue, likely, exclude=excluded[rows])
            for rows in (slice(start, start + _AT_ONCE) for start in range(0, queries, _AT_ONCE))
        ]
    )
    # Ties go to the lowest id; none comes last.
    alike = np.sort(alike.astype(np.uint32), axis=1).astype(np.int32)

    def work(start: int) -> MatchResult:
        rows = slice(start, min(start + chunk, queries))
        here, missing = rows_of(batch, rows), chunk - (rows.stop - rows.start)
        ids = alike[rows]
        known = catalogue.scans(np.maximum(ids, 0).reshape(-1))
        known = jax.tree.map(lambda array: array.reshape(*ids.shape, *array.shape[1:]), known)
        # A setting of the thread, of which each has its own.
        with single_precision():
            return _match_program(
                here.pad_batch(chunk),
                *(_padded(tree, missing) for tree in (excluded[rows], known, ids)),
                described_by,
                rules,
                together=not on_cpu,
            )

    # The first one compiles for all.
    starts = range(0, queries, chunk)
    results = [work(starts[0])]
    with ThreadPoolExecutor((os.cpu_count() or 1) if on_cpu else 1) as pool:
        results += pool.map(lambda start: jax.device_get(work(start)), starts[1:])
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:queries], *jax.device_get(results))


def _padded(tree: Any, missing: int) -> Any:
    """So many more queries, as the first one."""
    return jax.tree.map(lambda a: np.concatenate([a, np.repeat(a[:1], missing, axis=0)]), tree)


def _match_chunk(
    scans: Scan,
    excluded: Int[Array, "chunk any"],
    likely: Scan,
    ids: Int[Array, "chunk rows"],
    described_by: Packed[FeatureConfig],
    rules: Packed[MatchConfig],
    together: bool,
) -> MatchResult:
    """Queries, each with scans `(chunk, rows)` and ids of its own; -1 for none."""
    features, config = described_by.config, rules.config

    def one(of: tuple[Scan, Array, Scan, Array]) -> MatchResult:
        scan, excluded, likely, ids = of
        query = describe(scan, features)
        known = jax.vmap(describe, (0, None))(likely, features)
        nowhere = Placement(jnp.zeros((*ids.shape, 3)), jnp.zeros(ids.shape, bool))
        references = ReferenceIndex(known, EdgeTable.of(known.graph), ids, nowhere, described_by)
        histogram = jax.tree.map(lambda array: array[None], query.histogram)
        q_m = preselection_quality(histogram, known.histogram, features.relation)[0]
        return match_one(query, q_m, excluded, references, config)

    each = jax.vmap(lambda *of: one(of)) if together else lambda *of: jax.lax.map(one, of)
    return each(scans, excluded, likely, ids)


_match_program = Program(_match_chunk, MatchResult, static=("together",))
