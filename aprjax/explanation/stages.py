"""How far each reference got with one query, by the matcher's own stages."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.alignment.voting import vote
from aprjax.batch import match
from aprjax.evaluation.distinctiveness import rivalry
from aprjax.features import Features
from aprjax.matcher import (
    Evaluated,
    MatchConfig,
    MatchResult,
    Ranked,
    evaluate,
    exhaustive,
    preselected,
    rank,
)
from aprjax.numerics import single_precision
from aprjax.references import ReferenceIndex, ReferenceSet
from aprjax.relations.histograms import preselection_quality
from aprjax.scan import Scan
from aprjax.se2 import Pose
from aprjax.shortlist import Shortlist, glance_through, look_closer


class Stage(IntEnum):
    """The stage at which the last alternative of a reference fell out."""

    NOT_COMPARED = 0
    """It was excluded, or its q_m is not among the `top_k` highest."""
    ALIGNMENT = 1
    """Edges voted for no pose in it that was kept; without the cascade, no alignment was valid."""
    GLANCE = 2
    """None of its poses was among the best at a glance."""
    SECOND_LOOK = 3
    """None was kept by the second look: too few anchors agreed, or others looked better."""
    EVALUATION = 4
    """Its e_m is zero, below the least quality, or lower than those of K others."""
    ANSWERED = 5
    """It is among the hypotheses."""


class Left(eqx.Module):
    """Alternatives that were left after a stage, in all references."""

    T_ref_query: Float[Array, "size 3"]
    """Metres and radians."""
    row: Int[Array, " size"]
    """The reference."""
    score: Float[Array, " size"]
    """By which one represents its reference: higher is better."""
    valid: Bool[Array, " size"]


class Trace(eqx.Module):
    """One query on its way through the matcher."""

    q_m: Float[Array, " rows"]
    compared: Bool[Array, " rows"]
    aligned: Left
    passed: Left
    """Those that passed the glance; without the cascade, the same again."""
    kept: Left
    """Those that passed the second look."""
    evaluated: Evaluated
    ranked: Ranked
    rivalry: Float[Array, " K"]
    """How far each of the best excludes the very best: 0 for the same place, 1 for another one."""


@dataclass(frozen=True)
class Fate:
    """What became of one reference."""

    reference: int
    """Its id."""
    q_m: float
    aligned: int
    """Alternatives found by alignment."""
    passed: int
    """Of these, after the glance."""
    kept: int
    """Of these, after the second look."""
    e_m: float
    """The best of those evaluated, before rivals; 0 where there was none."""
    stage: Stage
    T_ref_query: Pose | None
    """The most promising alternative at the last stage it reached; None where there was none."""


@dataclass(frozen=True, eq=False)
class Account:
    """All that there is to tell of one query."""

    query: Features
    result: MatchResult
    e_m: np.ndarray
    """`(K,)`: of the hypotheses, before rivals were counted; NaN where two runs of the engine
    disagree in a tie."""
    rivalry: np.ndarray
    """`(K,)`: how far each hypothesis excludes the best; NaN likewise."""
    fates: list[Fate]
    """Of every reference, those that got farthest first."""


def account(
    scan: Scan, references: ReferenceSet, config: MatchConfig, exclude: Sequence[int]
) -> Account:
    """Match one scan, and tell what became of every reference. Raises as `match` does."""
    result = match(scan, references, config, exclude=exclude)
    # As a set of one, so that what was compiled for building sets serves here too.
    described = ReferenceSet.build([scan], references.config).index.features
    query = jax.tree.map(lambda array: array[0], described)
    excluded = np.asarray(list(exclude) or [-1], np.int32)
    with single_precision():
        trace = jax.device_get(_trace(query, excluded, references.index, config))
    best = trace.ranked.best
    same = references.ids[np.minimum(trace.evaluated.row[best], len(references) - 1)]
    same = result.valid & (same == result.reference)
    return Account(
        query=query,
        result=result,
        e_m=np.where(same, trace.evaluated.e_m[best], np.nan),
        rivalry=np.where(same, trace.rivalry, np.nan),
        fates=_fates(trace, references.ids, result),
    )


@jax.jit
def _trace(
    query: Features,
    excluded: Int[Array, " any"],
    references: ReferenceIndex,
    config: MatchConfig,
) -> Trace:
    features, relation = references.features, references.config.relation
    one = jax.tree.map(lambda array: array[None], query.histogram)
    q_m = preselection_quality(one, features.histogram, relation)[0]
    answering = references.valid & ~jnp.any(references.ids[:, None] == excluded[None, :], axis=1)
    compared = preselected(q_m, answering, config)
    if config.cascade:
        votes = vote(
            references.edges, features.histogram.edges, compared, query.graph, config.voting
        )
        aligned = Left(votes.T_ref_query, votes.row, votes.rating, votes.valid)
        rules = config.listing
        chosen = glance_through(votes, features, query, references.config.raster, rules)
        best_first = -jnp.arange(chosen.row.shape[0], dtype=jnp.float32)
        passed = Left(chosen.T_ref_query, chosen.row, best_first, chosen.valid)
        listed = look_closer(chosen, features, query, config.alignment, rules)
    else:
        _, listed = exhaustive(query, compared, references, config)
        aligned = passed = _left(listed)
    evaluated = evaluate(query, listed, features, config)
    ranked = rank(evaluated, references, config)
    best = ranked.best
    excluding = jax.vmap(rivalry, (None, 0, None, 0, None, None, None, None))(
        evaluated.row[best[0]],
        evaluated.row[best],
        evaluated.T_ref_query[best[0]],
        evaluated.T_ref_query[best],
        features.view,
        references.placement,
        config.congruence,
        config.distinctiveness,
    )
    return Trace(q_m, compared, aligned, passed, _left(listed), evaluated, ranked, excluding)


def _left(listed: Shortlist) -> Left:
    """Alternatives of a list; those on which more anchors agree represent their reference."""
    alternatives = listed.alternatives
    score = alternatives.anchors.astype(jnp.float32)
    return Left(alternatives.T_ref_query, listed.row, score, alternatives.valid)


def _fates(trace: Trace, ids: np.ndarray, result: MatchResult) -> list[Fate]:
    """The fates of all references, those that got farthest first."""
    evaluated = trace.evaluated
    settled = Left(evaluated.T_ref_query, evaluated.row, evaluated.e_m, evaluated.e_m > 0)
    stages = (trace.aligned, trace.passed, trace.kept, settled)

    def fate(row: int) -> Fate:
        of = [np.flatnonzero(left.valid & (left.row == row)) for left in stages]
        T_ref_query = None
        for left, found in zip(stages, of, strict=True):
            if found.size:
                T_ref_query = left.T_ref_query[found[np.argmax(left.score[found])]]
        if ids[row] in result.reference:
            stage = Stage.ANSWERED
        elif not trace.compared[row]:
            stage = Stage.NOT_COMPARED
        else:
            reached = (Stage.GLANCE, Stage.SECOND_LOOK, Stage.EVALUATION)
            after = [after for after, found in zip(reached, of, strict=False) if found.size]
            stage = after[-1] if after else Stage.ALIGNMENT
        e_m = float(evaluated.e_m[of[3]].max(initial=0.0))
        aligned, passed, kept = (len(found) for found in of[:3])
        q_m = float(trace.q_m[row])
        return Fate(int(ids[row]), q_m, aligned, passed, kept, e_m, stage, T_ref_query)

    fates = [fate(row) for row in range(len(ids))]
    return sorted(fates, key=lambda f: (-f.stage, -f.e_m, -f.kept, -f.passed, -f.q_m))
