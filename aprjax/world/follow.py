"""Following the robot through a part of the map that it knows: local matches, not global ones."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.view import View
from aprjax.plane import compose, distance, relative, spread, turn_spread, wrap
from aprjax.world.alignment import AlignConfig, Aligned, align_pairs
from aprjax.world.closure import Located
from aprjax.world.model import WorldModel
from aprjax.world.motion import NARROW_TURNS, Motion, turned
from aprjax.world.parts import Place
from aprjax.world.recognition import Sightings
from aprjax.world.super_space import Connection, neighbourhood

_ARCS = 3  # from the robot's node to those of references that may still show the place
_TURN = 1.5  # metres that a radian counts in how near a reference is


class FollowConfig(eqx.Module):
    """Which references a scan is aligned with, and when that has found its place."""

    align: AlignConfig = AlignConfig()
    candidates: int = capacity(4, "references that a scan is aligned with")
    reach: Float[Array, ""] = threshold(2.5, "metres to a reference")
    turn: Float[Array, ""] = threshold(np.radians(50), "radians to it")
    age: Float[Array, ""] = threshold(6.0, "metres of way since it was taken")
    agreement: Float[Array, ""] = threshold(0.08, "least agreement with it")
    loose: Float[Array, ""] = threshold(
        0.6, "metres: deviation of the expected pose from which more agreement is needed"
    )
    loose_turn: Float[Array, ""] = threshold(np.radians(6), "radians, likewise")
    firm: Float[Array, ""] = threshold(0.25, "least agreement then")
    quality: Float[Array, ""] = threshold(0.05, "least e_m of the matcher's answers to start from")
    off: Float[Array, ""] = threshold(0.4, "metres off what was expected, besides the deviations")
    off_turn: Float[Array, ""] = threshold(np.radians(6), "radians, likewise")
    deviations: Float[Array, ""] = threshold(3.0, "deviations that are allowed")


class Found(NamedTuple):
    """References that a scan was aligned with, best first."""

    references: np.ndarray
    """`(F,)` their scans' numbers."""
    aligned: Aligned
    """`(F,)`, first the reference."""


def follow(
    scan: int,
    expected: Located,
    references: dict[int, list[int]],
    places: dict[int, Place],
    seen: Sightings,
    moved: Motion,
    views: View,
    world: WorldModel,
    config: FollowConfig,
) -> Found | None:
    """Where a scan was taken among the references near where it is expected, if any agrees.

    `references` lists the scans that are references by node. Starts are the expected pose, and
    the matcher's answers that fit it.
    """
    near = neighbourhood(world, expected.place.node, _ARCS)
    chosen = _candidates(scan, expected, near, references, places, seen, moved, config)
    if not chosen:
        return None
    first = np.array([reference for reference, _ in chosen])
    poses = np.array([T for _, T in chosen])
    starts = turned(poses, NARROW_TURNS)
    second = np.full(len(first), scan)
    aligned = align_pairs(views, first, second, starts, np.ones(3), config.align)
    expectations = np.array(
        [_expected_from(reference, expected, near, places) for reference in first]
    )
    off = relative(expectations, aligned.T_first_second)
    # Where much is possible, something alike is found too easily.
    loose = (
        spread(expected.covariance) > config.loose
        or turn_spread(expected.covariance) > config.loose_turn
    )
    needed = config.firm if loose else config.agreement
    good = (aligned.agreement > needed) & _fits(off, expected, config)
    order = np.argsort(-aligned.agreement, kind="stable")
    order = order[good[order]]
    if not len(order):
        return None
    return Found(first[order], Aligned(*(array[order] for array in aligned)))


def _candidates(
    scan: int,
    expected: Located,
    near: dict[int, Connection],
    references: dict[int, list[int]],
    places: dict[int, Place],
    seen: Sightings,
    moved: Motion,
    config: FollowConfig,
) -> list[tuple[int, np.ndarray]]:
    """Scans to align with, and the poses in their frames to begin with."""
    listed = []
    for node in near:
        for reference in references.get(node, ()):
            if moved.way[scan] - moved.way[reference] < config.age:
                continue
            T = _expected_from(reference, expected, near, places)
            gap, turn = float(distance(T)), abs(T[2])
            if gap < config.reach and turn < config.turn:
                listed.append((gap + _TURN * turn, reference, T))
    listed.sort(key=lambda entry: entry[:2])

    answers = []
    for answer in seen.of(scan, scan):
        earlier = int(seen.earlier[answer])
        if seen.quality[answer] > config.quality and places[earlier].node in near:
            T = seen.T_earlier_scan[answer]
            off = relative(_expected_from(earlier, expected, near, places), T)
            if _fits(off, expected, config):
                answers.append((-seen.quality[answer], earlier, T))
    answers.sort(key=lambda entry: entry[:2])
    chosen = [*answers[: config.candidates // 2], *listed][: config.candidates]
    return [(number, T) for _, number, T in chosen]


def _expected_from(
    scan: int, expected: Located, near: dict[int, Connection], places: dict[int, Place]
) -> np.ndarray:
    """The expected pose in an earlier scan's frame."""
    place = places[scan]
    T = compose(near[place.node].T_start_end, place.T_node_laser)
    return relative(T, expected.place.T_node_laser)


def _fits(off: np.ndarray, expected: Located, config: FollowConfig) -> np.ndarray:
    """Whether poses `(..., 3)` relative to what was expected may be right."""
    way = config.off + config.deviations * spread(expected.covariance)
    turn = config.off_turn + config.deviations * turn_spread(expected.covariance)
    return (distance(off) < way) & (np.abs(wrap(off[..., 2])) < turn)
