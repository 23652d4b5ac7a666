"""Where the matcher's time goes: `python -m benchmarks stages`.

Each stage is jitted by itself and given what the stage before it made of one chunk of queries, as
`aprjax.matcher` works on it. Times are per scan and reference. Beside them:

- `operations`: arithmetic of the stage as it is written, loops counted as often as they run;
- `least bytes`: what goes in and comes out of it;
- `XLA flops`, `XLA bytes`: what the compiler counts after fusion; it takes the body of a loop once;
- how much of the time the machine's peak (`benchmarks.machine.peak`, all cores together) would
  need for the operations and for the least bytes.

The last row is the chunk as one program: one call, where a batch makes several, on each core one
at a time.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

import aprjax
from aprjax.alignment.voting import Votes, vote
from aprjax.features import Features, describe
from aprjax.matcher import Evaluated, evaluate, match_described, rank
from aprjax.programs import compiler_options
from aprjax.references import ReferenceIndex
from aprjax.refine import estimate
from aprjax.relations.histograms import preselection_quality
from aprjax.shortlist import Shortlist, glance_through, look_closer
from benchmarks.inputs import some, split
from benchmarks.machine import Peak, machine_name, peak
from benchmarks.report import text
from benchmarks.timing import timed
from benchmarks.workload import Skipped
from experiments.outputs import write_table

SPLIT = "intel.interleaved"


@dataclass(frozen=True)
class Stage:
    """A function of arrays, and what it is given."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    @cached_property
    def compiled(self) -> jax.stages.Compiled:
        """By itself, with the options that the matcher is compiled with."""
        jitted = jax.jit(self.function, compiler_options=compiler_options())
        return jitted.lower(*self.arguments).compile()


def run(quick: bool, out: Path | None) -> int:
    """Print the table and write it to `out`; the exit code."""
    try:
        scans = split(SPLIT)
    except Skipped as reason:
        print(reason, file=sys.stderr)
        return 1
    config = aprjax.MatchConfig()
    references = aprjax.ReferenceSet.build(scans.references)
    queries = some(scans.queries, slice(config.chunk))
    pairs = config.chunk * len(references)
    most = peak()
    table = [
        row(stage, pairs, most, 3 if quick else 15)
        for stage in stages(queries, references.index, config)
    ]
    header = (
        f"{machine_name()}; peak {most.flops / 1e9:.0f} Gflop/s, {most.bytes / 1e9:.1f} GB/s; "
        f"{config.chunk} scans of {SPLIT} × {len(references)} references"
    )
    print(f"{header}\n\n{text(table)}", end="")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_table(table, out / "stages.csv")
        (out / "stages.txt").write_text(f"{header}\n\n{text(table)}", encoding="utf-8")
    return 0


def stages(
    scans: aprjax.Scan, references: ReferenceIndex, config: aprjax.MatchConfig
) -> list[Stage]:
    """All stages of the cascade, in their order, each with what it is given."""
    features, views = references.features, references.features.view
    found: list[Stage] = []

    def stage(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        made = Stage(name, function, arguments)
        found.append(made)
        return made.compiled(*arguments)

    def each(function: Callable[..., Any]) -> Callable[..., Any]:
        """One query after the other, as the matcher does on a CPU."""
        return lambda *arguments: jax.lax.map(lambda args: function(*args), arguments)

    def describe_all(scans):
        return jax.vmap(describe, (0, None))(scans, references.config)

    def preselect(queries: Features):
        return preselection_quality(
            queries.histogram, features.histogram, references.config.relation
        )

    def vote_one(query: Features):
        k_m = features.histogram.edges
        return vote(references.edges, k_m, references.valid, query.graph, config.voting)

    def glance_one(query: Features, votes: Votes):
        return glance_through(votes, features, query, references.config.raster, config.listing)

    def look_one(query: Features, passed: Votes):
        return look_closer(passed, features, query, config.alignment, config.listing)

    def evaluate_one(query: Features, listed: Shortlist):
        return evaluate(query, listed, features, config)

    def rank_one(evaluated: Evaluated):
        best = rank(evaluated, references, config).best
        return evaluated.T_ref_query[best], evaluated.row[best]

    def estimate_one(query: Features, T_ref_query, row):
        def one(T_ref_query, row):
            view = jax.tree.map(lambda array: array[row], views)
            return estimate(view, query.view, T_ref_query, config.refine)

        return jax.vmap(one)(T_ref_query, row)

    queries = stage("extraction", describe_all, scans)
    stage("preselection", preselect, queries)
    votes = stage("voting", each(vote_one), queries)
    passed = stage("glance", each(glance_one), queries, votes)
    listed = stage("closer look", each(look_one), queries, passed)
    evaluated = stage("refinement, synthetic scans", each(evaluate_one), queries, listed)
    best = stage("rivals", each(rank_one), evaluated)
    stage("final estimate", each(estimate_one), queries, *best)
    nothing = np.full((len(scans.ranges), 1), -1, np.int32)
    stage("all of them", partial(_match_all, references, config), scans, nothing)
    return found


def _match_all(
    references: ReferenceIndex, config: aprjax.MatchConfig, scans: aprjax.Scan, excluded: jax.Array
):
    queries = jax.vmap(describe, (0, None))(scans, references.config)
    return match_described(queries, excluded, references, config, together=False)


def row(stage: Stage, pairs: int, most: Peak, repeats: int) -> dict[str, Any]:
    """A row of the table."""
    compiled = stage.compiled
    seconds = float(np.median(timed(lambda _: compiled(*stage.arguments), repeats)))
    traced, results = jax.make_jaxpr(stage.function, return_shape=True)(*stage.arguments)
    work = operations(traced.jaxpr)
    least = sum(
        leaf.size * np.dtype(leaf.dtype).itemsize
        for leaf in jax.tree.leaves((stage.arguments, results))
    ) + sum(np.asarray(constant).nbytes for constant in traced.consts)
    counted = compiled.cost_analysis() or {}
    return {
        "stage": stage.name,
        "µs": _digits(1e6 * seconds / pairs),
        "operations": _digits(work / pairs),
        "least bytes": _digits(least / pairs),
        "XLA flops": _digits(counted.get("flops", float("nan")) / pairs),
        "XLA bytes": _digits(counted.get("bytes accessed", float("nan")) / pairs),
        "% of peak flops": _digits(100 * work / most.flops / seconds),
        "% of peak bytes": _digits(100 * least / most.bytes / seconds),
    }


_FREE = {  # they move or name values
    *("broadcast_in_dim", "reshape", "transpose", "squeeze", "expand_dims", "slice", "rev", "copy"),
    *(
        "concatenate",
        "pad",
        "iota",
        "convert_element_type",
        "gather",
        "dynamic_slice",
        "stop_gradient",
    ),
    *("dynamic_update_slice", "bitcast_convert_type", "copy_p", "split"),
}


def operations(jaxpr: Any) -> float:
    """Arithmetic and comparisons of a traced function, one for each element.

    Products count 2 n for sums of n, Fourier transforms 5 n log₂ n, other functions one for each
    element of what they return, or take where that is more (reductions). The body of a loop
    counts as often as it runs; once where that is decided by the data.
    """
    total = 0.0
    for equation in jaxpr.eqns:
        name, parameters = equation.primitive.name, equation.params
        inner = [p for value in parameters.values() for p in _jaxprs(value)]
        sizes = [variable.aval.size for variable in (*equation.invars, *equation.outvars)]
        if inner:
            times = parameters.get("length", 1) if name == "scan" else 1
            reducer = name.startswith(("reduce", "scatter"))
            # A reduction to several results is as many.
            results = len(equation.outvars)
            total += max(sizes) * results if reducer else times * sum(map(operations, inner))
        elif name == "dot_general":
            (contracted, _), _ = parameters["dimension_numbers"]
            shape = equation.invars[0].aval.shape
            total += 2 * equation.outvars[0].aval.size * np.prod([shape[k] for k in contracted])
        elif name == "fft":
            (length, *_) = parameters["fft_lengths"]
            total += 5 * np.log2(length) * max(sizes)
        elif name not in _FREE:
            total += max(sizes)
    return float(total)


def _jaxprs(value: Any) -> list[Any]:
    """The traced functions in a parameter of an equation."""
    if isinstance(value, tuple | list):
        return [jaxpr for each in value for jaxpr in _jaxprs(each)]
    value = getattr(value, "jaxpr", value)
    return [value] if hasattr(value, "eqns") else []


def _digits(value: float) -> float:
    """To three digits."""
    return float(f"{value:.3g}")
