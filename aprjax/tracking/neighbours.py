"""Poses of different nodes compared in the super space, and estimates that mean one place."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from aprjax.plane import compose, compose_covariance, distance, relative, spread, turn_spread
from aprjax.tracking.hypothesis import Hypothesis, VolumeConfig, volume_size
from aprjax.tracking.sources import Estimate
from aprjax.world.model import WorldModel
from aprjax.world.parts import Place
from aprjax.world.super_space import Connection, connections


class Neighbours:
    """The surroundings of nodes in the super space, kept once they have been asked for.

    The world model must not be edited meanwhile.
    """

    def __init__(self, world: WorldModel, reach: float) -> None:
        """`reach` bounds the metres along the arcs to nodes that a place is compared with."""
        self._world, self._reach = world, reach
        self._known: dict[tuple[int, float], dict[int, Connection]] = {}

    def of(self, node: int, beyond: float = 0.0) -> dict[int, Connection]:
        """The nodes within reach and `beyond`, along the least uncertain arcs."""
        key = node, beyond
        if key not in self._known:
            self._known[key] = connections(self._world, node, self._reach + beyond)
        return self._known[key]

    def beyond(self, place: Place) -> float:
        """Metres searched beyond the reach, for a place that is far from its node's origin.

        A robot that nothing confirms takes its home node along. In halves of the reach, so that
        what was searched is found again.
        """
        half = 0.5 * self._reach
        if not 0.0 < half < math.inf:
            return 0.0
        return float(distance(place.T_node_laser) // half * half)

    def off(self, one: Place, other: Place) -> tuple[np.ndarray, float, float] | None:
        """`T_one_other`, and the deviation in metres and in radians that the arcs give it.

        None beyond reach.
        """
        if one.node == other.node:
            return relative(one.T_node_laser, other.T_node_laser), 0.0, 0.0
        beyond = max(self.beyond(one), self.beyond(other))
        link = self.of(one.node, beyond).get(other.node)
        if link is None:
            return None
        T = compose(link.T_start_end, other.T_node_laser)
        covariance = compose_covariance(
            link.T_start_end, link.covariance, other.T_node_laser, np.zeros((3, 3))
        )
        return relative(one.T_node_laser, T), spread(covariance), turn_spread(covariance)

    def within(
        self, one: Place, other: Place, radius: float, angle: float, deviations: float
    ) -> bool:
        """Whether `other` lies in the volume of `radius` metres and `angle` radians around `one`.

        What the arcs between them may be off, so many `deviations` of it, widens the volume.
        """
        off = self.off(one, other)
        if off is None:
            return False
        T, way, turn = off
        return bool(
            distance(T) <= radius + deviations * way and abs(T[2]) <= angle + deviations * turn
        )


class Surroundings:
    """Things with places, such as reference scans: those around a pose are found at once."""

    def __init__(self, near: Neighbours, places: Mapping[int, Place]) -> None:
        """`places` by the things' numbers; nodes within the reach of `near` are searched."""
        self._near = near
        self._numbers: dict[int, list[int]] = {}
        self._poses: dict[int, list[np.ndarray]] = {}
        for number, place in sorted(places.items()):
            self._numbers.setdefault(place.node, []).append(number)
            self._poses.setdefault(place.node, []).append(place.T_node_laser)
        self._known: dict[tuple[int, float], tuple[np.ndarray, np.ndarray]] = {}

    def around(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Numbers `(n,)` of the things within reach, ascending, and `T_thing_place` `(n, 3)`."""
        key = place.node, self._near.beyond(place)
        if key not in self._known:
            links = self._near.of(*key)
            around = [other for other in links if other in self._numbers]
            numbers = [number for other in around for number in self._numbers[other]]
            poses = [
                compose(links[other].T_start_end, np.array(self._poses[other])) for other in around
            ]
            order = np.argsort(numbers)
            self._known[key] = (
                np.array(numbers, int)[order],
                np.concatenate([np.zeros((0, 3)), *poses])[order],
            )
        numbers, T_node_thing = self._known[key]
        return numbers, relative(T_node_thing, place.T_node_laser)


def merge(estimates: Sequence[Estimate], near: Neighbours, config: VolumeConfig) -> list[Estimate]:
    """Estimates that several references give of one place become one, the most probable of them."""
    kept: list[Estimate] = []
    for estimate in sorted(estimates, key=lambda e: -e.probability):
        radius, angle = volume_size(estimate.covariance, config)
        if not any(
            near.within(other.place, estimate.place, radius, angle, float(config.deviations))
            for other in kept
        ):
            kept.append(estimate)
    return kept


def seen_from(
    hypothesis: Hypothesis, near: Neighbours, world: WorldModel
) -> tuple[int, np.ndarray] | None:
    """A reference's id near a hypothesis, and the centre `(3,)` in that reference scan's frame.

    It is the one that the hypothesis was confirmed by, or else the nearest of its home node, or of
    the nodes around. None if there is no reference within reach.
    """
    place = hypothesis.place
    if hypothesis.reference in world.appearances:
        at = world.appearances[hypothesis.reference].place
        if at.node == place.node:
            return hypothesis.reference, relative(at.T_node_laser, place.T_node_laser)
    best = None
    for reference, appearance in world.appearances.items():
        off = near.off(appearance.place, place)
        if off is not None:
            key = appearance.place.node != place.node, float(distance(off[0]))
            if best is None or key < best[0]:
                best = key, reference, off[0]
    return None if best is None else best[1:]
