import numpy as np
import pytest

from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place
from aprjax.world.store import load_map
from tests.world.rings import mapped
from tests.worlds import free_pose, office, scan_at

SURE = np.diag([1e-4, 1e-4, 1e-5])


@pytest.fixture(scope="session")
def built():
    """A map of one lap and a half round a ring, and the true poses of its scans."""
    _, path, truth = mapped()
    return load_map(path), truth


@pytest.fixture
def square():
    """Four nodes at the corners of a square of 2 m, headings along the way round, and a fifth."""
    world = WorldModel()
    for node in range(5):
        world.add_node(10 * node)
    ahead = np.array([2.0, 0.0, np.pi / 2])
    for a, b in ((0, 1), (1, 2), (2, 3)):
        world.add_arc(Arc(a, b, ahead, SURE, "driven"))
    world.add_arc(Arc(3, 0, ahead, SURE, "closed"))
    rng, plan = np.random.default_rng(0), office(seed=5)
    scans = [scan_at(plan, free_pose(plan, rng), beams=61) for _ in range(3)]
    lasers = [(0, (0.5, 0.0, 0.1)), (0, (0.0, 0.2, np.pi / 2)), (2, (1.8, 0.1, 0.0))]
    seen = [Appearance(Place(node, np.array(T)), 10 * node) for node, T in lasers]
    world.add_references(scans, seen)
    world.add_image(Appearance(Place(1, np.array([0.3, 0.0, 0.0])), 12, image_class=7))
    for node in range(5):
        world.place_scan(10 * node, Place(node, np.zeros(3)))
    world.check()
    return world
