"""A robot that is tracked in a map with the references of a split, as it would be live."""

from collections.abc import Callable

import jax
import numpy as np

from aprjax.plane import relative
from aprjax.tracking.belief import Belief
from aprjax.tracking.tracker import HypothesisTracker
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place
from benchmarks.inputs import some
from experiments.data import Split

NODE = 5.0  # metres of a reference from the nearest node, beyond which it makes one itself
_COVARIANCE = np.diag([0.05, 0.05, 0.01]) ** 2  # of arcs: m², rad²


def world_of(split: Split) -> WorldModel:
    """Nodes where references are far from those before, arcs in the order of the drive.

    Poses are the true ones: how well a map is built is not what is measured with it.
    """
    world, origins = WorldModel(), np.empty((0, 3))
    places, last = [], None
    for T_world_ref in split.T_world_ref:
        far = np.hypot(*(origins - T_world_ref)[:, :2].T)
        if not len(far) or far.min() > NODE:
            origins, node = np.vstack([origins, T_world_ref]), world.add_node()
        else:
            node = int(np.argmin(far))
        if last is not None and node != last and not world.graph.has_edge(last, node):
            T_last_node = relative(origins[last], origins[node])
            world.add_arc(Arc(last, node, T_last_node, _COVARIANCE, "driven"))
        places.append(Appearance(Place(node, relative(origins[node], T_world_ref))))
        last = node
    scans = [some(split.references, row) for row in range(len(places))]
    world.add_references(scans, places)
    return world


def drive(split: Split) -> Callable[[int], Belief]:
    """One step of the default tracker: odometry, here the truth, and scan number `step`, modulo."""
    tracker = HypothesisTracker(world_of(split))
    scans = [
        jax.tree.map(np.asarray, some(split.queries, row))
        for row in range(len(split.queries.ranges))
    ]

    def step(number: int) -> Belief:
        row = number % len(scans)
        tracker.move(odometry=split.T_world_query[row], scan=scans[row])
        return tracker.observe(scan=scans[row])

    return step
