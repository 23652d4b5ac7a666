"""A corridor of nodes four metres apart, made by hand, and sources that say what they are told."""

import numpy as np

from aprjax.scan import Scan
from aprjax.tracking.hypothesis import Step
from aprjax.tracking.sources import Estimate, Verdict
from aprjax.tracking.tracker import HypothesisTracker
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place

SPACING = 4.0
EXACT = np.zeros((3, 3))


def corridor(nodes=3, deviation=0.02):
    """Nodes in a row, each with a reference at its origin: scan 10 in node 0, 11 in node 1, …"""
    world = WorldModel()
    covariance = np.diag([deviation**2, deviation**2, 0.01**2])
    for node in range(nodes):
        world.add_node(10 + node)
        if node:
            world.add_arc(Arc(node - 1, node, np.array([SPACING, 0, 0]), covariance, "driven"))
    scan = Scan.make(np.ones(5), angle_min=-1.0, angle_increment=0.5, range_max=8.0)
    world.add_references(
        [scan] * nodes, [Appearance(Place(n, np.zeros(3)), scan=10 + n) for n in range(nodes)]
    )
    return world


def at(node=0, x=0.0, y=0.0, theta=0.0, *, probability=0.9):
    """An estimate of a pose in a node's frame."""
    place = Place(node, np.array([x, y, theta]))
    return Estimate(place, EXACT, probability, reference=node)


def drive(x=1.0, y=0.0, theta=0.0, deviation=0.0, doubt=0.0):
    """A step, seen from where the robot was."""
    covariance = np.diag([deviation**2, deviation**2, (0.2 * deviation) ** 2])
    return Step(np.array([x, y, theta], float), covariance, doubt)


class Told:
    """A primary source whose readings are its estimates."""

    reads = "estimates"

    def locate(self, reading, world):
        return reading


class Driven:
    """A tracking source whose readings are its steps."""

    reads = "step"

    def step(self, reading, expected):
        return reading


class Judge:
    """A validation source whose readings are functions from a hypothesis to a verdict."""

    reads = "verdict"

    def judge(self, reading, hypotheses, world):
        return [reading(hypothesis) for hypothesis in hypotheses]


def tracker(world=None, **changes):
    """A tracker of told sources."""
    sources = {"primary": [Told()], "tracking": [Driven()], "validation": [Judge()]}
    return HypothesisTracker(corridor() if world is None else world, **{**sources, **changes})


def sure(node=0, x=0.0, y=0.0, theta=0.0, times=4, **changes):
    """A tracker with one dominant hypothesis, which was confirmed at a pose again and again."""
    made = tracker(**changes)
    for _ in range(times):
        made.observe(estimates=[at(node, x, y, theta, probability=0.99)])
        made.move(step=drive(1.0))
        made.move(step=drive(-1.0))
    made.observe(estimates=[at(node, x, y, theta, probability=0.99)])
    return made


def approve(likelihood, **better):
    """A verdict on every hypothesis."""
    return lambda hypothesis: Verdict(likelihood, **better)


def total(belief):
    return sum(h.probability for h in belief.hypotheses) + belief.rest
