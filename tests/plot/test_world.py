import numpy as np
import pytest
from matplotlib.collections import LineCollection

from aprjax.plot.style import figure_of
from aprjax.plot.world import draw_world
from aprjax.scan import Scan
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place
from aprjax.world.super_space import assemble


@pytest.fixture
def world():
    """Three nodes in a row, the last arc back torn by 0.5 m, and one reference at the second."""
    world = WorldModel()
    for node in range(3):
        world.add_node(node)
    ahead, sure = np.array([2.0, 0.0, 0.0]), 1e-4 * np.eye(3)
    world.add_arc(Arc(0, 1, ahead, sure, "driven"))
    world.add_arc(Arc(1, 2, ahead, sure, "driven"))
    world.add_arc(Arc(0, 2, 2 * ahead + np.array([0.0, 0.5, 0.0]), 9e-2 * np.eye(3), "closed"))
    scan = Scan.make(np.full(11, 3.0), angle_min=-0.5, angle_increment=0.1, range_max=10)
    place = Place(1, np.array([0.0, 0.0, np.pi / 2]))
    world.add_references([scan], [Appearance(place, 1)])
    return world


def axes_of(drawn):
    (ax,) = figure_of(drawn).axes
    return ax


def lines(drawn):
    return {
        each.get_label(): np.array(each.get_segments())
        for each in drawn
        if isinstance(each, LineCollection)
    }


def test_arcs_are_lines_by_kind_and_a_torn_one_shows_its_gap(world):
    drawn = lines(draw_world(world, assemble(world)))
    np.testing.assert_allclose(drawn["arcs driven (2)"][:, :, 0], [[0, 2], [2, 4]])
    assert len(drawn["arcs closed (1)"]) == 1
    (gap,) = drawn["torn arcs (1, up to 0.50 m)"]
    np.testing.assert_allclose(gap, [[4, 0.5], [4, 0]])


def test_references_look_where_their_lasers_looked(world):
    drawn = lines(draw_world(world, assemble(world), scans=False))
    (tick,) = next(segments for label, segments in drawn.items() if label.startswith("_"))
    np.testing.assert_allclose(tick[0], [2, 0], atol=1e-9)
    assert tick[1, 0] == pytest.approx(2)
    assert tick[1, 1] > 0


def test_scans_lie_before_their_references(world):
    ax = axes_of(draw_world(world, assemble(world)))
    points = ax.collections[0].get_offsets()
    assert len(points) == 11
    np.testing.assert_allclose(np.hypot(*(points - [2, 0]).T), 3.0, rtol=1e-6)


def test_nodes_that_the_frame_lacks_are_left_out(world):
    world.add_node(3)
    ax = axes_of(draw_world(world, assemble(world)))
    assert "nodes (3)" in ax.get_legend_handles_labels()[1]
