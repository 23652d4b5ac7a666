"""The APR matcher as primary source: every reference scan of the world model, in one call."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from aprjax.batch import match
from aprjax.matcher import MatchConfig
from aprjax.plane import compose, compose_covariance
from aprjax.result import MatchResult
from aprjax.tracking.sources import Estimate
from aprjax.world.model import WorldModel
from aprjax.world.parts import Place

_LEAST = 0.01  # probability of an alternative that is worth an estimate


class AprSource:
    """Global matches of a scan with the references, as poses in their home nodes."""

    reads = "scan"

    def __init__(self, config: MatchConfig | None = None) -> None:
        self.config = MatchConfig(hypotheses=10) if config is None else config

    def locate(self, reading: Any, world: WorldModel) -> Sequence[Estimate]:
        """The matcher's alternatives for a `Scan`."""
        return estimates(match(reading, world.references, self.config), world)


class MatchedSource:
    """The same from results computed beforehand, as a log's are in batches.

    A reading is a `MatchResult` of one scan.
    """

    reads = "match"

    def locate(self, reading: MatchResult, world: WorldModel) -> Sequence[Estimate]:
        """The alternatives of a result."""
        return estimates(reading, world)


def estimates(result: MatchResult, world: WorldModel) -> list[Estimate]:
    """The alternatives of a match of one scan with `world.references`, best first."""
    found = []
    for k in np.flatnonzero(np.asarray(result.valid)):
        probability = float(result.probability[k])
        if probability < _LEAST:
            continue
        reference = int(result.reference[k])
        at = world.appearances[reference].place
        T_ref_query = np.asarray(result.T_ref_query[k], float)
        covariance = compose_covariance(
            at.T_node_laser,
            np.zeros((3, 3)),
            T_ref_query,
            np.asarray(result.covariance[k], float),
        )
        place = Place(at.node, compose(at.T_node_laser, T_ref_query))
        found.append(Estimate(place, covariance, probability, reference))
    return found
