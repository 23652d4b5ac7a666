import jax
import numpy as np
import pytest

from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from tests.oracles import evaluation as oracle
from tests.worlds import cast, office

look_up = jax.jit(lambda view, xy: view.look_up(xy))

# First bearing and step in degrees, beams: partial, full turn, both upside down, uneven.
SCANNERS = {
    "half turn": (-90, 1.0, 181),
    "half turn upside down": (90, -1.0, 181),
    "narrow, looking left": (60, 0.5, 120),
    "full turn": (-180, 2.0, 180),
    "full turn upside down": (35, -2.0, 180),
    "three quarters": (-135, 1.5, 181),
}


def scanner(name, world, pose):
    first, step, beams = SCANNERS[name]
    angle_min, increment = np.radians([first, step])
    ranges = cast(world, pose, angle_min + increment * np.arange(beams))
    return Scan.make(ranges, angle_min=angle_min, angle_increment=increment, range_max=30.0)


@pytest.fixture(scope="module")
def views():
    world = office(seed=3)
    scans = [scanner(name, world, np.array([6.0, 0.1, 0.7])) for name in SCANNERS]
    everything = jax.tree.map(np.asarray, ReferenceSet.build(scans).index.features.view)
    return {
        name: jax.tree.map(lambda array, row=row: array[row], everything)
        for row, name in enumerate(SCANNERS)
    }


@pytest.mark.parametrize("name", SCANNERS)
def test_a_point_is_looked_up_at_the_nearest_bearing(views, name):
    rng = np.random.default_rng(1)
    angle, distance = rng.uniform(-np.pi, np.pi, 400), rng.uniform(0.1, 20, 400)
    xy = np.stack([distance * np.cos(angle), distance * np.sin(angle)], -1).astype(np.float32)
    index, visible = look_up(views[name], xy)
    expected, inside = oracle.look_up(views[name], xy)
    np.testing.assert_array_equal(visible, inside)
    np.testing.assert_array_equal(np.asarray(index)[inside], expected[inside])


@pytest.mark.parametrize("name", SCANNERS)
def test_each_hit_is_found_at_its_own_beam(views, name):
    view = views[name]
    xy = np.resize(view.xy[view.hit], (400, 2))
    index, visible = look_up(view, xy)
    np.testing.assert_array_equal(index, np.resize(np.nonzero(view.hit)[0], 400))
    assert np.all(visible)
