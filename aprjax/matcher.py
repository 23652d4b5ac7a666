"""APR scan matching: section 2 of the paper, from features to weighted global alignments."""

from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from aprjax.alignment.align import AlignmentConfig, align, counterparts
from aprjax.alignment.voting import VotingConfig, vote
from aprjax.calls import CHUNK
from aprjax.configuration import capacity, threshold
from aprjax.evaluation.congruence import CongruenceConfig, both_ways, quality, sees
from aprjax.evaluation.distinctiveness import (
    DistinctivenessConfig,
    distinct_quality,
    rivalry,
    same_pose,
)
from aprjax.evaluation.probability import ProbabilityConfig, probability
from aprjax.features import Features
from aprjax.references import ReferenceIndex
from aprjax.refine import RefineConfig, Refined, estimate, settle
from aprjax.relations.histograms import (
    direction_spectrum,
    matching_angles,
    preselection_quality,
)
from aprjax.result import Counts, MatchResult
from aprjax.se2 import Pose, inverse
from aprjax.shortlist import Shortlist, ShortlistConfig, all_alternatives, shortlist
from aprjax.status import Status


class MatchConfig(eqx.Module):
    """How queries are compared with references, stage by stage.

    How scans are described belongs to the `ReferenceSet`, since it holds for both sides.
    """

    voting: VotingConfig = VotingConfig()
    alignment: AlignmentConfig = AlignmentConfig()
    shortlist: ShortlistConfig = ShortlistConfig()
    refine: RefineConfig = RefineConfig()
    congruence: CongruenceConfig = CongruenceConfig()
    distinctiveness: DistinctivenessConfig = DistinctivenessConfig()
    probability: ProbabilityConfig = ProbabilityConfig()
    min_quality: Float[Array, ""] = threshold(0.0, "least quality of a hypothesis", most=1.0)
    confident: Float[Array, ""] = threshold(
        0.18, "least quality of an answer that may be acted on", most=1.0
    )
    top_k: int | None = capacity(None, "references compared, those of the highest q_m; None is all")
    cascade: bool = capacity(
        True, "whether edges vote, and only a shortlist is fully evaluated; else the paper's way"
    )
    hypotheses: int = capacity(
        5, "K, the most hypotheses of a query; beyond `shortlist.kept`, more is evaluated for them"
    )
    chunk: int = capacity(CHUNK, "queries worked on at a time, at most, which bounds the memory")

    @property
    def listing(self) -> ShortlistConfig:
        """The shortlist's rules, with room for as many alternatives as hypotheses are asked for."""
        rules, most = self.shortlist, self.hypotheses
        return replace(rules, passed=max(rules.passed, most), kept=max(rules.kept, most))


class Evaluated(eqx.Module):
    """The shortlisted alternatives of a query, refined and compared by synthetic scans."""

    T_ref_query: Float[Array, "kept 3"]
    row: Int[Array, " kept"]
    e_m: Float[Array, " kept"]
    """0 for those that are not valid."""
    anchors: Int[Array, " kept"]
    """Anchors that agree."""
    beams: Float[Array, " kept"]
    """Beams that agree, of both scans."""


class Ranked(eqx.Module):
    """The K best of the evaluated alternatives."""

    best: Int[Array, " K"]
    """Their indices."""
    quality: Float[Array, " K"]
    rival: Bool[Array, ""]
    """Whether another place explains the scan about as well as the best."""


def match_described(
    queries: Features,
    excluded: Int[Array, "chunk any"],
    references: ReferenceIndex,
    config: MatchConfig,
    together: bool,
) -> MatchResult:
    """Section 2 of the paper after extraction, for a few queries at once.

    `excluded` are ids of references that must not answer. Queries are aligned and evaluated
    `together`, or one after the other: on a CPU what one query needs then stays in the cache.
    """
    relation = references.config.relation
    q_m = preselection_quality(queries.histogram, references.features.histogram, relation)
    spectra = None if config.cascade else direction_spectra(references)

    def one(of: tuple[Features, Array, Array]) -> MatchResult:
        return match_one(*of, references, config, spectra)

    each = jax.vmap(one) if together else partial(jax.lax.map, one)
    return each((queries, q_m, excluded))


def match_one(
    query: Features,
    q_m: Float[Array, " rows"],
    excluded: Int[Array, " any"],
    references: ReferenceIndex,
    config: MatchConfig,
    spectra: Complex[Array, "rows frequencies length_bins"] | None = None,
) -> MatchResult:
    """One query, in the order of section 2: alignments, their evaluation, the best of them.

    `spectra` as in `exhaustive`.
    """
    answering = references.valid & ~jnp.any(references.ids[:, None] == excluded[None, :], axis=1)
    allowed = preselected(q_m, answering, config)
    candidates = cascade if config.cascade else partial(exhaustive, spectra=spectra)
    found, listed = candidates(query, allowed, references, config)
    evaluated = evaluate(query, listed, references.features, config)
    ranked = rank(evaluated, references, config)
    counts = Counts.of(query, found, listed)
    return answer(query, q_m, evaluated, ranked, counts, references, config)


def cascade(
    query: Features,
    allowed: Bool[Array, " rows"],
    references: ReferenceIndex,
    config: MatchConfig,
) -> tuple[Int[Array, " rows"], Shortlist]:
    """Poses that edges vote for, how many in each reference, and the best after two quick looks."""
    votes = vote(
        references.edges,
        references.features.histogram.edges,
        allowed,
        query.graph,
        config.voting,
    )
    found = votes.found(allowed.shape[0])
    listed = shortlist(
        votes,
        references.features,
        query,
        references.config.raster,
        config.alignment,
        config.listing,
    )
    return found, listed


def exhaustive(
    query: Features,
    allowed: Bool[Array, " rows"],
    references: ReferenceIndex,
    config: MatchConfig,
    spectra: Complex[Array, "rows frequencies length_bins"] | None = None,
) -> tuple[Int[Array, " rows"], Shortlist]:
    """All alternatives of the paper's alignment with each reference, and how many there are.

    `spectra` are the references' `direction_spectra`, where several queries share them.
    """
    relation = references.config.relation
    graphs = references.features.graph
    spectra = direction_spectra(references) if spectra is None else spectra
    angles = matching_angles(direction_spectrum(query.graph, relation)[None], spectra, relation)[0]
    aligned = jax.vmap(align, (0, None, 0, None))(graphs, query.graph, angles, config.alignment)
    aligned = eqx.tree_at(lambda a: a.valid, aligned, aligned.valid & allowed[:, None])
    found = jnp.sum(aligned.valid, axis=1, dtype=jnp.int32)
    return found, all_alternatives(aligned, jnp.arange(allowed.shape[0]))


def direction_spectra(
    references: ReferenceIndex,
) -> Complex[Array, "rows frequencies length_bins"]:
    """The `direction_spectrum` of every reference."""
    graphs, relation = references.features.graph, references.config.relation
    return jax.vmap(direction_spectrum, (0, None))(graphs, relation)


def preselected(
    q_m: Float[Array, " rows"], answering: Bool[Array, " rows"], config: MatchConfig
) -> Bool[Array, " rows"]:
    """Those `answering` that are among the `top_k` of the highest q_m; ties go to the lowest id."""
    if config.top_k is None or config.top_k >= q_m.shape[0]:
        return answering
    _, rows = jax.lax.top_k(jnp.where(answering, q_m, -1.0), config.top_k)
    return answering & jnp.zeros(q_m.shape[0], bool).at[rows].set(True)


def evaluate(
    query: Features, listed: Shortlist, references: Features, config: MatchConfig
) -> Evaluated:
    """Each alternative refined, then compared by synthetic scans in both directions (2.D)."""

    def one(T_ref_query: Pose, row: Int[Array, ""]):
        reference = jax.tree.map(lambda array: array[row], references)
        T_ref_query = settle(reference.view, query.view, T_ref_query, config.refine)
        ahead, back = both_ways(reference.view, query.view, T_ref_query, config.congruence)
        anchors = counterparts(
            reference.graph, query.graph, T_ref_query, config.alignment.agreement
        )
        e_m = quality(
            ahead,
            back,
            sees(reference.view, T_ref_query[:2]),
            sees(query.view, inverse(T_ref_query)[:2]),
            anchors,
            config.congruence.quality,
        )
        return T_ref_query, e_m, anchors, ahead.agree + back.agree

    kept = listed.alternatives
    T_ref_query, e_m, anchors, beams = jax.vmap(one)(kept.T_ref_query, listed.row)
    e_m = jnp.where(kept.valid, e_m, 0.0)
    return Evaluated(T_ref_query, listed.row, e_m, anchors, beams)


def rank(evaluated: Evaluated, references: ReferenceIndex, config: MatchConfig) -> Ranked:
    """The K best alternatives, their qualities, and whether the best one has an equal rival.

    Alternatives of one reference that refinement brought to the same pose are one hypothesis. How
    many hypotheses are asked for changes the quality of none, unless they are more than
    `ShortlistConfig.kept`: then more alternatives are evaluated, which may be rivals.
    """
    rules = config.distinctiveness
    T_ref_query, row = evaluated.T_ref_query, evaluated.row

    def choose(left, _):
        best = jnp.argmax(left)
        same = (row == row[best]) & same_pose(T_ref_query, T_ref_query[best][None], rules)
        return jnp.where(same, 0.0, left).at[best].set(0.0), (best, left[best])

    size = max(rules.rivals, config.hypotheses)
    _, (best, e_m) = jax.lax.scan(choose, evaluated.e_m, length=size)
    excluding = jax.vmap(rivalry, (None, 0, None, 0, None, None, None, None))(
        row[best[0]],
        row[best],
        T_ref_query[best[0]],
        T_ref_query[best],
        references.features.view,
        references.placement,
        config.congruence,
        rules,
    )
    quality, strongest = distinct_quality(e_m, excluding, rules)
    _, order = jax.lax.top_k(quality, config.hypotheses)
    rival = (strongest > 0) & (strongest >= rules.equal * e_m[0])
    return Ranked(best[order], quality[order], rival)


def answer(
    query: Features,
    q_m: Float[Array, " rows"],
    evaluated: Evaluated,
    ranked: Ranked,
    counts: Counts,
    references: ReferenceIndex,
    config: MatchConfig,
) -> MatchResult:
    """The hypotheses that reach `min_quality`, with their final poses and covariances."""
    best, qualities = ranked.best, ranked.quality
    valid = (qualities >= config.min_quality) & (qualities > 0)

    def final(T_ref_query: Pose, row: Int[Array, ""]) -> Refined:
        view = jax.tree.map(lambda array: array[row], references.features.view)
        return estimate(view, query.view, T_ref_query, config.refine)

    def known(array):
        mask = valid.reshape(valid.shape + (1,) * (array.ndim - 1))
        return jnp.where(mask, array, jnp.zeros_like(array))

    row = evaluated.row[best]
    estimated = jax.vmap(final)(evaluated.T_ref_query[best], row)
    return MatchResult(
        reference=jnp.where(valid, references.ids[row], -1),
        T_ref_query=known(estimated.T_ref_query),
        covariance=known(estimated.covariance),
        quality=jnp.where(valid, qualities, 0.0),
        probability=jnp.where(valid, probability(qualities, config.probability), 0.0),
        preselection=known(q_m[row]),
        agreeing_anchors=known(evaluated.anchors[best]),
        agreeing_beams=known(evaluated.beams[best].astype(jnp.int32)),
        valid=valid,
        confident=valid[0] & ~ranked.rival & (qualities[0] >= config.confident),
        counts=counts,
        status=_status(counts, valid[0], ranked.rival),
    )


def _status(counts: Counts, accepted: Bool[Array, ""], rival: Bool[Array, ""]) -> Int[Array, ""]:
    """The first of the outcomes that applies, in the order of the stages."""
    cases = [
        (counts.anchors < 2, Status.TOO_FEW_ANCHORS),
        (counts.alternatives == 0, Status.NO_CANDIDATE),
        (~accepted, Status.BELOW_THRESHOLD),
        (rival, Status.AMBIGUOUS),
        (counts.overflow > 0, Status.CAPACITY_EXCEEDED),
    ]
    conditions = [condition for condition, _ in cases]
    return jnp.select(conditions, [jnp.int32(status) for _, status in cases], jnp.int32(Status.OK))
