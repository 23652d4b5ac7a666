"""Sweeps: many configurations over the same scans, with thresholds along axes.

One `vmap` over the swept leaves of a `MatchConfig`, for one query after the other. What does not
depend on a swept value stays unbatched, down to the single operation, and so is computed once: 64
tolerances of the congruence share votes, shortlist, refinement and even synthetic scans; values of
`min_quality` share everything. A loop over configurations with the stages that they share taken
out of it by hand (`jax.lax.map`) was slower. `python -m benchmarks 'sweep.*'` says what 64
configurations cost.

Voting is the exception. Its thresholds decide how often its loops run, and a batched loop selects
among all counters in every round. Configurations are grouped by them, and groups follow each
other with what was compiled for the first.
"""

import itertools
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from aprjax.calls import rows_of
from aprjax.configuration import check_kind
from aprjax.describing import describe_chunk
from aprjax.features import Features
from aprjax.matcher import MatchConfig, direction_spectra, match_one
from aprjax.numerics import bucket, single_precision
from aprjax.programs import Program
from aprjax.references import ReferenceIndex, ReferenceSet, check_references
from aprjax.relations.histograms import preselection_quality
from aprjax.result import Counts, MatchResult
from aprjax.scan import Scan, as_stack
from aprjax.sweeping.axes import FEATURES, check_names, check_values, configured, product

CONFIGURATIONS, QUERIES = 64, 8
"""At a time, at most: a query's alternatives are there for each configuration, and all cores are to
have an equal share of the queries."""


class Keeper(Protocol):
    """Where finished pieces are kept, so that an interrupted sweep goes on where it was.

    One belongs to one sweep: what is kept under a name is taken for that of the same scans,
    references and configurations. `aprjax.io.pieces` keeps them in files and tells them apart.
    """

    def load(self, name: str) -> dict[str, np.ndarray] | None:
        """The columns stored under this name, if they are there."""
        ...

    def store(self, name: str, columns: dict[str, np.ndarray]) -> None:
        """Keep the columns under this name."""
        ...


@dataclass(frozen=True)
class Piece:
    """Some configurations for some queries: what is computed, and kept, at once."""

    name: str
    configurations: int
    queries: int
    seconds: float
    """What it took, with compilation in the first one."""


def sweep(
    scans: Sequence[Scan] | Scan,
    references: ReferenceSet,
    configs: MatchConfig,
    *,
    keep: Keeper | None = None,
    watch: Callable[[Piece], None] | None = None,
) -> MatchResult:
    """`match_batch` with many configurations; the result has axes `(configurations, queries)`.

    Some thresholds of `configs` are arrays `(configurations,)`, see `configured`. Other values
    compile nothing; another choice of thresholds, and other shapes, do. The figures are those of
    `match_batch` but for the order of float32 sums: qualities and poses agree to 1e-5, save where
    two hypotheses are equally good. On a CPU the queries are shared among its cores. Finished
    pieces go to `keep`, and those found there are not computed; `watch` is told of each. Raises
    `ValueError` for thresholds of different lengths, for none that is an array, for no scan, for
    no reference, and for arguments of another kind.
    """
    check_kind("configs", configs, MatchConfig)
    check_references(references, ReferenceSet)
    count = _count(configs)
    batch = as_stack(scans, "queries")
    queries = batch.ranges.shape[0]
    size = min(QUERIES, bucket(queries, smallest=1))
    groups = list(_groups(configs, count))

    def work(start: int) -> tuple[list[MatchResult], list[Piece]]:
        here = rows_of(batch, slice(start, start + size))
        # A setting of the thread, of which each has its own.
        with single_precision():
            return _work(start, here, size, references.index, configs, groups, keep)

    workers = (os.cpu_count() or 1) if jax.default_backend() == "cpu" else 1
    starts = range(0, queries, size)
    found: list[list[MatchResult]] = []
    with ThreadPoolExecutor(workers) as pool:
        for results, pieces in pool.map(work, starts):
            found.append(results)
            if watch is not None:
                for piece in pieces:
                    watch(piece)
    order = np.argsort(np.concatenate(groups), kind="stable")

    def joined(*parts: np.ndarray) -> np.ndarray:
        """Leaves of all pieces, those of the same queries next to each other."""
        rows = [parts[k : k + len(groups)] for k in range(0, len(parts), len(groups))]
        return np.concatenate([np.concatenate(row) for row in rows], axis=1)[order]

    return jax.tree.map(joined, *itertools.chain.from_iterable(found))


def sweep_grid(
    scans: Sequence[Scan] | Scan,
    references: ReferenceSet,
    axes: Mapping[str, Sequence[float] | np.ndarray],
    config: MatchConfig | None = None,
    *,
    keep: Keeper | None = None,
    watch: Callable[[Piece], None] | None = None,
) -> MatchResult:
    """`sweep` over all combinations of thresholds, in the order of `product`.

    Names are those of `MatchConfig`, such as `congruence.tolerance`, or of `FeatureConfig` with
    `features.` before them. The references are described anew for each choice of the latter, and
    all else is swept within it. Raises `ValueError` as `product`, `check_values` and `sweep` do.
    """
    check_names(axes)
    check_references(references, ReferenceSet)
    columns, config = product(axes), MatchConfig() if config is None else config
    for name, values in axes.items():
        check_values(name, np.asarray(values))
    check_kind("config", config, MatchConfig)
    described = {name: column for name, column in columns.items() if name.startswith(FEATURES)}
    matched = {name: column for name, column in columns.items() if name not in described}
    choices, choice = _unique(list(described.values()), len(next(iter(columns.values()))))
    parts, rows = [], []
    for number, values in enumerate(choices):
        here = np.flatnonzero(choice == number)
        names = [name.removeprefix(FEATURES) for name in described]
        features = configured(references.config, dict(zip(names, values, strict=True)))
        known = references
        if described:
            known = ReferenceSet.restore(
                references.scans,
                references.ids,
                references.next_id,
                features,
                references.T_world_ref,
            )
        configs = configured(config, {name: column[here] for name, column in matched.items()})
        if not matched:
            configs = replace(configs, min_quality=np.full(1, configs.min_quality))
        kept = None if keep is None else _Part(keep, f"{number:04d}-")
        parts.append(sweep(scans, known, configs, keep=kept, watch=watch))
        rows.append(here)
    order = np.argsort(np.concatenate(rows), kind="stable")
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[order], *parts)


@dataclass(frozen=True)
class _Part:
    """The pieces of one description of the scans, among those of others."""

    keep: Keeper
    prefix: str

    def load(self, name: str) -> dict[str, np.ndarray] | None:
        return self.keep.load(self.prefix + name)

    def store(self, name: str, columns: dict[str, np.ndarray]) -> None:
        self.keep.store(self.prefix + name, columns)


def _count(configs: MatchConfig) -> int:
    """How many configurations there are."""
    lengths = {np.shape(leaf) for leaf in jax.tree.leaves(configs) if np.ndim(leaf)}
    if len(lengths) != 1 or len(shape := lengths.pop()) != 1 or not shape[0]:
        raise ValueError("configs: thresholds are to be swept, as arrays of one length")
    return shape[0]


def _unique(columns: list[np.ndarray], count: int) -> tuple[np.ndarray, np.ndarray]:
    """The different rows of columns `(count,)`, and which of them each row is."""
    if not columns:
        return np.empty((1, 0)), np.zeros(count, int)
    rows, which = np.unique(np.column_stack(columns), axis=0, return_inverse=True)
    return rows, which.reshape(count)


def _groups(configs: MatchConfig, count: int) -> Iterator[np.ndarray]:
    """Indices of configurations that vote alike, at most `CONFIGURATIONS` at a time."""
    swept = [np.asarray(leaf) for leaf in jax.tree.leaves(configs.voting) if np.ndim(leaf)]
    _, which = _unique(swept if configs.cascade else [], count)
    for group in range(which.max() + 1):
        here = np.flatnonzero(which == group)
        yield from np.array_split(here, -(-len(here) // CONFIGURATIONS))


def _work(
    start: int,
    scans: Scan,
    size: int,
    references: ReferenceIndex,
    configs: MatchConfig,
    groups: list[np.ndarray],
    keep: Keeper | None,
) -> tuple[list[MatchResult], list[Piece]]:
    """The results `(configurations, queries)` of each group for the same few queries."""
    count, most = scans.ranges.shape[0], max(map(len, groups))
    described, results, pieces = None, [], []
    for number, index in enumerate(groups):
        began, name = time.perf_counter(), f"{start:08d}-{number:06d}"
        columns = None if keep is None else keep.load(name)
        if columns is None:
            if described is None:
                described = describe_chunk(scans.pad_batch(size), references.described_by)
            padded = np.pad(index, (0, most - len(index)), mode="edge")
            result = jax.device_get(
                _sweep_program(
                    described,
                    references,
                    _chosen(configs, padded),
                    count=most,
                    together=jax.default_backend() != "cpu",
                )
            )
            result = jax.tree.map(lambda leaf: leaf[:count].swapaxes(0, 1)[: len(index)], result)  # noqa: B023
            columns = _columns(result) | {"seconds": np.asarray(time.perf_counter() - began)}
            if keep is not None:
                keep.store(name, columns)
        results.append(_result(columns))
        pieces.append(Piece(name, len(index), count, float(columns["seconds"])))
    return results, pieces


def _chosen(configs: MatchConfig, index: np.ndarray) -> MatchConfig:
    """Configurations that vote alike: their voting is a single one."""

    def of(which: Any) -> Callable[[Any], Any]:
        return lambda leaf: np.asarray(leaf)[which] if np.ndim(leaf) else leaf

    chosen = jax.tree.map(of(index), configs)
    if configs.cascade:
        voting = jax.tree.map(of(index[0]), configs.voting)
        chosen = eqx.tree_at(lambda c: c.voting, chosen, voting)
    return chosen


def _sweep_chunk(
    queries: Features,
    references: ReferenceIndex,
    configs: MatchConfig,
    count: int,
    together: bool,
) -> MatchResult:
    """Leading axes `(queries, count)`."""
    axes = jax.tree.map(lambda leaf: 0 if jnp.ndim(leaf) else None, configs)
    nothing = jnp.full(1, -1, jnp.int32)
    spectra = None if configs.cascade else direction_spectra(references)
    relation = references.config.relation
    q_m = preselection_quality(queries.histogram, references.features.histogram, relation)

    def one(of: tuple[Features, Array]) -> MatchResult:
        each = partial(match_one, *of, nothing, references, spectra=spectra)
        return jax.vmap(each, (axes,), axis_size=count)(configs)

    return (jax.vmap(one) if together else partial(jax.lax.map, one))((queries, q_m))


_sweep_program = Program(_sweep_chunk, MatchResult, static=("count", "together"))


_NAMES = [f.name for f in fields(MatchResult) if f.name != "counts"]
_COUNTED = [f.name for f in fields(Counts)]


def _columns(result: MatchResult) -> dict[str, np.ndarray]:
    counts = {f"counts.{name}": getattr(result.counts, name) for name in _COUNTED}
    return {name: getattr(result, name) for name in _NAMES} | counts


def _result(columns: Mapping[str, Any]) -> MatchResult:
    counts = Counts(**{name: columns[f"counts.{name}"] for name in _COUNTED})
    return MatchResult(**{name: columns[name] for name in _NAMES}, counts=counts)
