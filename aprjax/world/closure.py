"""When the robot is back at a known place (paper section 3): the decision to close a cycle.

One scan may look like a place that it does not show. So several scans over some way have to say
the same: their answers, carried to the present pose by how the robot moved between them, must meet
in one place of the map; no other place may have nearly as much to say for it; and the cycle that
this would close must be one that dead reckoning along the arcs allows.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import capacity, threshold
from aprjax.plane import (
    compose,
    compose_covariance,
    distance,
    relative,
    spread,
    turn_spread,
    wrap,
)
from aprjax.world.model import WorldModel
from aprjax.world.motion import Motion
from aprjax.world.parts import Place
from aprjax.world.recognition import Sightings
from aprjax.world.super_space import Connection, connections, neighbourhood

_ARCS = 3  # between the nodes of answers that may mean one place


class ClosureConfig(eqx.Module):
    """How much evidence closes a cycle, and what dead reckoning allows."""

    window: Float[Array, ""] = threshold(6.0, "metres of way over which answers are collected")
    scans: int = capacity(3, "least number of scans whose answers agree")
    way: Float[Array, ""] = threshold(1.5, "least metres of way between the first and the last")
    weight: Float[Array, ""] = threshold(0.3, "least sum of their e_m, the best of each scan")
    rival: Float[Array, ""] = threshold(0.5, "share of it that another place may have at most")
    apart: Float[Array, ""] = threshold(1.0, "metres from which another pose is another place")
    turned: Float[Array, ""] = threshold(np.radians(15), "radians, likewise")
    agree: Float[Array, ""] = threshold(0.35, "metres that agreeing answers may lie apart")
    agree_per_metre: Float[Array, ""] = threshold(0.04, "metres that way between them adds")
    agree_turn: Float[Array, ""] = threshold(np.radians(4), "radians, likewise")
    agree_turn_per_metre: Float[Array, ""] = threshold(np.radians(0.6), "radians, likewise")
    drift: Float[Array, ""] = threshold(0.2, "metres: deviation of dead reckoning, at least")
    drift_per_metre: Float[Array, ""] = threshold(0.02, "metres that a metre of the cycle adds")
    drift_turn: Float[Array, ""] = threshold(np.radians(1.5), "radians, likewise")
    drift_turn_per_metre: Float[Array, ""] = threshold(np.radians(0.1), "radians, likewise")
    deviations: Float[Array, ""] = threshold(2.0, "deviations that a cycle may miss its start by")


class Located(NamedTuple):
    """A pose in the super space and how well it is known there."""

    place: Place
    covariance: np.ndarray
    """`(3, 3)` of the pose in the node's frame."""

    def moved(self, step: np.ndarray, covariance: np.ndarray) -> "Located":
        """After a motion."""
        T = self.place.T_node_laser
        place = Place(self.place.node, compose(T, step))
        return Located(place, compose_covariance(T, self.covariance, step, covariance))


class _Claim(NamedTuple):
    """What one answer says about the present pose."""

    scan: int
    quality: float
    place: Place
    T_node_here: np.ndarray
    """The present pose in the frame of the node that the robot believes to be at."""


def recognize(
    scan: int,
    believed: Located,
    since: int,
    seen: Sightings,
    places: dict[int, Place],
    moved: Motion,
    world: WorldModel,
    config: ClosureConfig,
) -> Place | None:
    """The known place where `scan` was taken, if there is enough evidence for one.

    Answers to scans after number `since` count, as far as they lie within the window before
    `scan`. `believed` is where dead reckoning has it; `places` says where earlier scans were.
    """
    start = int(np.searchsorted(moved.way, moved.way[scan] - config.window))
    answers = seen.of(max(start, since + 1), scan)
    if scan not in seen.scan[answers] or len(set(seen.scan[answers])) < config.scans:
        return None
    reach = connections(world, believed.place.node)
    claims = []
    for answer in answers:
        place = places[int(seen.earlier[answer])]
        taken = int(seen.scan[answer])
        if place.node in reach:
            T = compose(seen.T_earlier_scan[answer], moved.step(taken, scan))
            here = Place(place.node, compose(place.T_node_laser, T))
            link = reach[place.node]
            since_then = moved.way[scan] - moved.way[taken]
            if _allowed(here, link, since_then, believed, config):
                T_node_here = compose(link.T_start_end, here.T_node_laser)
                claims.append(_Claim(taken, float(seen.quality[answer]), here, T_node_here))
    return _decide(scan, claims, moved, world, config)


def _allowed(
    here: Place, link: Connection, since: float, believed: Located, config: ClosureConfig
) -> bool:
    """Whether dead reckoning along the arcs can be so far off as `here` says."""
    T_node_here = compose(link.T_start_end, here.T_node_laser)
    off = T_node_here - believed.place.T_node_laser
    at_end = compose_covariance(
        link.T_start_end, link.covariance, here.T_node_laser, np.zeros((3, 3))
    )
    covariance = at_end + believed.covariance
    way = link.length + since
    place = spread(covariance) + config.drift + config.drift_per_metre * way
    heading = turn_spread(covariance) + config.drift_turn + config.drift_turn_per_metre * way
    return bool(
        distance(off) < config.deviations * place
        and abs(wrap(off[2])) < config.deviations * heading
    )


def _decide(
    scan: int, claims: list[_Claim], moved: Motion, world: WorldModel, config: ClosureConfig
) -> Place | None:
    """The place that most of the claims agree on, unless another has nearly as much."""
    near: dict[int, dict[int, Connection]] = {}
    best = None
    weights = []
    for claim in claims:
        node = claim.place.node
        if node not in near:
            near[node] = neighbourhood(world, node, _ARCS)
        agreeing: dict[int, float] = {}
        for other in claims:
            if other.place.node in near[node] and _agree(claim, other, near[node], moved, config):
                agreeing[other.scan] = max(agreeing.get(other.scan, 0.0), other.quality)
        way = moved.way[list(agreeing)]
        weight = sum(agreeing.values())
        weights.append(weight)
        enough = (
            len(agreeing) >= config.scans
            and np.ptp(way) >= config.way
            and weight >= config.weight
            and scan in agreeing
        )
        if enough and (best is None or weight > best[0]):
            best = weight, claim
    if best is None:
        return None
    for claim, weight in zip(claims, weights, strict=True):
        off = _off(best[1], claim, near[best[1].place.node])
        elsewhere = distance(off) > config.apart or abs(off[2]) > config.turned
        if elsewhere and weight > config.rival * best[0]:
            return None
    return best[1].place


def _agree(
    one: _Claim,
    other: _Claim,
    near: dict[int, Connection],
    moved: Motion,
    config: ClosureConfig,
) -> bool:
    """Whether two answers mean one present pose."""
    off = _off(one, other, near)
    way = abs(moved.way[one.scan] - moved.way[other.scan]) + 1.0
    return bool(
        distance(off) < config.agree + config.agree_per_metre * way
        and abs(off[2]) < config.agree_turn + config.agree_turn_per_metre * way
    )


def _off(one: _Claim, other: _Claim, near: dict[int, Connection]) -> np.ndarray:
    """The present pose by one answer in that by another, along the shortest way between them.

    `near` is the neighbourhood of the first. From the robot, what lies beside each other may be
    reached the one or the other way round a cycle that is torn.
    """
    link = near.get(other.place.node)
    if link is None:
        return relative(one.T_node_here, other.T_node_here)
    return relative(one.place.T_node_laser, compose(link.T_start_end, other.place.T_node_laser))
