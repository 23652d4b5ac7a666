"""What matching returns of each query, on the device or on the host."""

from dataclasses import fields
from functools import cache
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.features import Features
from aprjax.packing import Packing
from aprjax.shortlist import Shortlist


class Counts(eqx.Module):
    """How much was left after each stage."""

    anchors: Int[Array, "*batch"]
    """Anchors of the query."""
    overflow: Int[Array, "*batch"]
    """Anchors that the capacity left out, counted up to the capacity."""
    aligned: Int[Array, "*batch"]
    """References with at least one alternative."""
    alternatives: Int[Array, "*batch"]
    """Alternatives of all references."""
    evaluated: Int[Array, "*batch"]
    """Alternatives that were refined and compared by synthetic scans."""

    @classmethod
    def of(cls, query: Features, found: Int[Array, " rows"], listed: Shortlist) -> Self:
        """Of one query, with so many alternatives `found` in each reference."""
        return cls(
            anchors=jnp.sum(query.anchors.valid, dtype=jnp.int32),
            overflow=query.anchors.overflow,
            aligned=jnp.sum(found > 0, dtype=jnp.int32),
            alternatives=jnp.sum(found, dtype=jnp.int32),
            evaluated=jnp.sum(listed.alternatives.valid, dtype=jnp.int32),
        )


class MatchResult(eqx.Module):
    """Hypotheses of where each query was taken, best first over all references.

    Entries that are not `valid` hold zeros, and -1 for the reference.
    """

    reference: Int[Array, "*batch K"]
    """Id of the reference scan."""
    T_ref_query: Float[Array, "*batch K 3"]
    """Pose of the query's laser in the reference scan's frame; metres, radians."""
    covariance: Float[Array, "*batch K 3 3"]
    """Of `T_ref_query`: m², m rad, rad²."""
    quality: Float[Array, "*batch K"]
    """In [0, 1]: e_m less what rivals cost. As the counts of what agrees, it is of the alignment
    that was evaluated, of which the last solve then makes `T_ref_query`."""
    probability: Float[Array, "*batch K"]
    """Of being right, from the quality; see `aprjax.evaluation.probability` for what it assumes."""
    preselection: Float[Array, "*batch K"]
    """q_m of the reference."""
    agreeing_anchors: Int[Array, "*batch K"]
    """Anchors of the query with a counterpart in the reference."""
    agreeing_beams: Int[Array, "*batch K"]
    """Compared beams, of both scans, that agree with the synthetic scans."""
    valid: Bool[Array, "*batch K"]
    confident: Bool[Array, "*batch"]
    """Whether the best hypothesis may be acted on: its quality reaches `MatchConfig.confident`,
    and no rival explains the scan about as well. Where it is false, the robot is lost."""
    counts: Counts
    status: Int[Array, "*batch"]
    """A `Status`."""


@cache
def result_packing(hypotheses: int) -> Packing[MatchResult]:
    """How results of so many hypotheses come to the host."""

    def numbers(*shape: int) -> Any:
        return jax.ShapeDtypeStruct(shape, jnp.float32)

    def counts(*shape: int) -> Any:
        return jax.ShapeDtypeStruct(shape, jnp.int32)

    def truths(*shape: int) -> Any:
        return jax.ShapeDtypeStruct(shape, jnp.bool_)

    one = MatchResult(
        reference=counts(hypotheses),
        T_ref_query=numbers(hypotheses, 3),
        covariance=numbers(hypotheses, 3, 3),
        quality=numbers(hypotheses),
        probability=numbers(hypotheses),
        preselection=numbers(hypotheses),
        agreeing_anchors=counts(hypotheses),
        agreeing_beams=counts(hypotheses),
        valid=truths(hypotheses),
        confident=truths(),
        counts=Counts(*(counts() for _ in fields(Counts))),
        status=counts(),
    )
    return Packing(one)
