import numpy as np

from aprjax.world.model import WorldModel
from aprjax.world.parts import Arc
from aprjax.world.tidy import drop_small_cycles

SURE = np.diag([1e-4, 1e-4, 1e-5])


def crossing(far: float) -> WorldModel:
    """A corridor 0-1-2, and arcs to 1 and 2 from node 3, `far` metres off in another corridor."""
    world = WorldModel()
    places = np.array([(-4.0, 0.0), (0.0, 0.0), (2.0, 0.0), (0.5, far)])
    for _ in places:
        world.add_node()
    for a, b in ((0, 1), (1, 2), (3, 1), (3, 2)):
        T = np.append(places[b] - places[a], 0.0)
        world.add_arc(Arc(a, b, T, SURE, "driven" if b != 2 else "closed"))
    return world


def test_a_crossing_is_no_cycle():
    world = crossing(far=3.0)
    drop_small_cycles(world, 12.0)
    assert [(arc.a, arc.b) for arc in world.arcs()] == [(0, 1), (1, 2), (3, 1)]


def test_a_way_round_something_stays_a_cycle():
    world = crossing(far=6.0)
    drop_small_cycles(world, 12.0)
    assert world.graph.number_of_edges() == 4
