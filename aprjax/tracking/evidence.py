"""How a belief changes: moved, confirmed, punished, created, settled (paper 4.A). Pure functions.

The probability model. The robot is in the volume V_i of one of the hypotheses, or in none: the
rest hypothesis. λ_i and λ_0 are the probabilities of these cases, and sum to one. What a source
says of a reading multiplies each λ by the likelihood of the reading in that case relative to its
likelihood anywhere else, and all are divided by their sum (Bayes). The rest is anywhere else: its
ratio is 1. So it is punished when hypotheses are confirmed, and rewarded when they are not.

    reward      an estimate of odds o = p / (1 - p) in V_i:   missed + gain * o, at most `most`
    punishment  no estimate in V_i:                           missed
    creation    an estimate in no volume takes from the rest: share * (missed + gain * o) * λ_0,
                at most `initial`; of the rest, that share was in the new volume all along
    validation  the ratio that the source states

`missed` is the probability that a primary source does not find a place that it should know;
`gain` says how much seldomer a wrong estimate falls just there. Readings over a short way see the
same and err alike. So a ratio counts with the power min(way / independence, 1), `way` being that
since the source's last reading, turns included: at rest nothing adds up, but for the share of the
rest that every other place takes that is named there; and over a way the evidence does not depend
on how often the scanner looks.

The robot may be carried away, or leave a volume unnoticed: with every metre each λ_i loses a
share, `leak`, to the rest; a source of motion that doubts its step takes away that share more, and
what a volume no longer holds that has grown to its bounds goes the same way; and λ_0 never falls
below `rest`, for no evidence is beyond doubt.

Estimates of one reading that name different places exclude each other: p is that of being the right
one among them, from the odds that the source gives each.

Departures from the paper. It does not state its rewards and punishments; here they are likelihood
ratios. Its tracking sources leave all λ alone; here the proportions of the λ_i stay while volumes
are within their bounds, but leak and doubt shift weight from all of them to the rest. Its
validation sources confirm or reject; here iterative dual correspondence rejects nothing (see
`aprjax.tracking.validation`). An estimate that would be rather wrong than right even if the robot
were in the volume rewards a hypothesis and does not move its centre. Hypotheses that meet become
one.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import capacity, threshold
from aprjax.tracking.belief import Belief
from aprjax.tracking.hypothesis import (
    Hypothesis,
    Step,
    VolumeConfig,
    share_held,
    volume_size,
    with_floors,
)
from aprjax.tracking.neighbours import Neighbours
from aprjax.tracking.sources import Estimate, Verdict
from aprjax.world.parts import Place


class EvidenceConfig(eqx.Module):
    """The numbers of the probability model in the module's description."""

    volume: VolumeConfig = VolumeConfig()
    gain: Float[Array, ""] = threshold(5.0, "likelihood ratio of a confirmation at even odds")
    most: Float[Array, ""] = threshold(40.0, "largest likelihood ratio of one confirmation")
    missed: Float[Array, ""] = threshold(0.4, "likelihood ratio where nothing confirms")
    share: Float[Array, ""] = threshold(0.05, "of the rest that lies in one new volume")
    initial: Float[Array, ""] = threshold(0.3, "most that a new hypothesis begins with")
    least: Float[Array, ""] = threshold(0.002, "λ below which a hypothesis is deleted")
    leak: Float[Array, ""] = threshold(0.015, "share of each λ lost to the rest per metre")
    rest: Float[Array, ""] = threshold(0.02, "least λ_0")
    independence: Float[Array, ""] = threshold(
        1.0, "metres over which readings err alike", least=1e-3
    )
    per_turn: Float[Array, ""] = threshold(0.5, "metres that a radian of turning counts")
    trusted: Float[Array, ""] = threshold(
        0.5, "least probability, if the robot is in their volume, of estimates that move its centre"
    )
    same: Float[Array, ""] = threshold(0.25, "metres between centres that are one hypothesis")
    same_turn: Float[Array, ""] = threshold(np.radians(5), "radians, likewise")
    hypotheses: int = capacity(30, "most explicit hypotheses; the least probable go")


def moved(belief: Belief, step: Step, config: EvidenceConfig) -> Belief:
    """All centres carried on by a step, all volumes grown, and the rest too.

    That grows by leak, by doubt, and by what volumes at their bounds no longer hold.
    """
    kept = (1.0 - float(config.leak)) ** travelled(step, config) * (1.0 - step.doubt)
    volume = config.volume
    left = []
    for before in belief.hypotheses:
        now, was = before.moved(step, volume), share_held(before.covariance, volume)
        # A covariance that shrinks on the way back brings nothing back: evidence does.
        share = min(share_held(now.covariance, volume) / was, 1.0) if was > 0 else 1.0
        left.append(replace(now, probability=before.probability * kept * share))
    left.sort(key=_order)
    return replace(belief, hypotheses=tuple(left), rest=_rest(left))


def travelled(step: Step, config: EvidenceConfig) -> float:
    """Metres of way that a step counts, turns included."""
    return step.way + float(config.per_turn) * step.turn


def weight(way: float, config: EvidenceConfig) -> float:
    """The power with which a ratio counts, `way` metres after the source's last reading."""
    return min(way / float(config.independence), 1.0)


def reward(probability: float, config: EvidenceConfig) -> float:
    """The likelihood ratio of an estimate that is right with this probability."""
    odds = probability / max(1.0 - probability, 1e-6)
    return min(float(config.missed) + float(config.gain) * odds, float(config.most))


def given(probability: float, config: EvidenceConfig) -> float:
    """The probability of an estimate if the robot is in the volume that it lies in.

    The likelihood ratio of `reward` has two parts: right estimates, and none that is.
    """
    right = float(config.gain) * probability / max(1.0 - probability, 1e-6)
    return right / (float(config.missed) + right)


def exclusive(estimates: Sequence[Estimate]) -> list[float]:
    """The probability of each of several estimates of different places: one is right, or none.

    Each comes with its odds against none. A scan of a place that looks like three others names all
    four with great certainty, and tells them apart by no more than the ratios of their odds.
    """
    odds = [estimate.probability / max(1.0 - estimate.probability, 1e-3) for estimate in estimates]
    every = 1.0 + math.fsum(odds)
    return [own / every for own in odds]


def located(
    belief: Belief,
    estimates: Sequence[Estimate],
    weight: float,
    near: Neighbours,
    config: EvidenceConfig,
) -> Belief:
    """After a primary source's reading: hypotheses confirmed or punished, and new ones.

    `estimates` are of different places; see `neighbours.merge`. A hypothesis is confirmed by the
    most probable one in its volume.
    """
    shares = exclusive(estimates)
    deviations = float(config.volume.deviations)
    explained: set[int] = set()
    updated = []
    for hypothesis in belief.hypotheses:
        inside = [
            number
            for number, estimate in enumerate(estimates)
            if near.within(
                hypothesis.place, estimate.place, hypothesis.radius, hypothesis.angle, deviations
            )
        ]
        explained.update(inside)
        best = max(inside, key=lambda number: estimates[number].probability, default=None)
        if best is None:
            updated.append(_rewarded(hypothesis, None, weight, config))
            continue
        updated.append(_rewarded(hypothesis, shares[best], weight, config))
        # If the robot is in this volume, no other estimate is right.
        if given(estimates[best].probability, config) >= config.trusted:
            updated[-1] = _confirmed(updated[-1], estimates[best], config)

    total = sum(h.probability for h in updated) + belief.rest
    new = [number for number in range(len(estimates)) if number not in explained]
    # What lies in the new volumes is no longer anywhere else.
    part = belief.rest * min(float(config.share), 1.0 / max(len(new), 1))
    for born, number in enumerate(new, belief.born):
        ratio = reward(shares[number], config) ** weight
        updated.append(_created(born, estimates[number], part * ratio, total, config))
    left = belief.rest - part * len(new)
    return settled(updated, left, belief.born + len(new), near, config)


def judged(
    belief: Belief,
    verdicts: Sequence[Verdict],
    weight: float,
    near: Neighbours,
    config: EvidenceConfig,
) -> Belief:
    """After a validation source's reading, which has a verdict for each hypothesis in order."""
    updated = []
    for hypothesis, verdict in zip(belief.hypotheses, verdicts, strict=True):
        likelier = replace(
            hypothesis, probability=hypothesis.probability * verdict.likelihood**weight
        )
        if verdict.place is not None and verdict.likelihood > 1.0:
            covariance = np.zeros((3, 3)) if verdict.covariance is None else verdict.covariance
            reference = verdict.reference
            likelier = _recentred(likelier, verdict.place, covariance, reference, config)
        updated.append(likelier)
    return settled(updated, belief.rest, belief.born, near, config)


def settled(
    hypotheses: Sequence[Hypothesis],
    rest: float,
    born: int,
    near: Neighbours,
    config: EvidenceConfig,
) -> Belief:
    """Weights made probabilities: divided by their sum, those that met joined, the least deleted.

    What was deleted goes to the rest.
    """
    total = sum(h.probability for h in hypotheses) + rest
    kept: list[Hypothesis] = []
    for hypothesis in sorted(hypotheses, key=_order):
        likelihood = hypothesis.probability / total
        for k, other in enumerate(kept):
            if near.within(
                other.place, hypothesis.place, float(config.same), float(config.same_turn), 0.0
            ):
                kept[k] = replace(other, probability=other.probability + likelihood)
                break
        else:
            kept.append(replace(hypothesis, probability=likelihood))
    kept = [h for h in kept if h.probability >= config.least]
    kept = sorted(kept, key=_order)[: config.hypotheses]
    most = 1.0 - float(config.rest)
    total = sum(h.probability for h in kept)
    if total > most:
        kept = [replace(h, probability=h.probability * most / total) for h in kept]
    return Belief(tuple(kept), _rest(kept), born)


def _rewarded(
    hypothesis: Hypothesis, probability: float | None, weight: float, config: EvidenceConfig
) -> Hypothesis:
    """Rewarded by an estimate of this probability in its volume, or punished for none."""
    ratio = float(config.missed) if probability is None else reward(probability, config)
    return replace(hypothesis, probability=hypothesis.probability * ratio**weight)


def _confirmed(hypothesis: Hypothesis, estimate: Estimate, config: EvidenceConfig) -> Hypothesis:
    """Moved to an estimate in its volume, in the configuration space of that one's home node."""
    return _recentred(hypothesis, estimate.place, estimate.covariance, estimate.reference, config)


def _recentred(
    hypothesis: Hypothesis,
    place: Place,
    covariance: np.ndarray,
    reference: int | None,
    config: EvidenceConfig,
) -> Hypothesis:
    """About another centre, with the small volume to begin with."""
    covariance = with_floors(covariance, config.volume)
    centred = hypothesis.at(place, covariance, config.volume)
    return replace(centred, reference=reference, unconfirmed=0.0, turned=0.0)


def _created(
    number: int,
    estimate: Estimate,
    weighed: float,
    total: float,
    config: EvidenceConfig,
) -> Hypothesis:
    """A new hypothesis, with its part of the rest as its likelihood ratio has `weighed` it."""
    probability = min(weighed, float(config.initial) * total)
    covariance = with_floors(estimate.covariance, config.volume)
    radius, angle = volume_size(covariance, config.volume)
    return Hypothesis(
        number, estimate.place, covariance, radius, angle, probability, estimate.reference
    )


def _order(hypothesis: Hypothesis) -> tuple[float, int]:
    """The most probable first, and of equals the oldest."""
    return -hypothesis.probability, hypothesis.number


def _rest(hypotheses: Sequence[Hypothesis]) -> float:
    return max(1.0 - math.fsum(h.probability for h in hypotheses), 0.0)
