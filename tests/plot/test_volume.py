import numpy as np
import pytest
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from aprjax.plot.style import figure_of
from aprjax.plot.volume import draw_volumes, in_degrees, show_box
from aprjax.tracking.hypothesis import Hypothesis
from aprjax.world.parts import Place
from aprjax.world.super_space import assemble
from tests.tracking.worlds import SPACING, corridor


def volume(node=0, pose=(1.0, 2.0, 0.5), radius=0.75, angle=0.4, probability=0.9):
    place = Place(node, np.array(pose))
    return Hypothesis(0, place, np.eye(3), radius, angle, probability)


def rims(drawn):
    """The lower and the upper circle `(points, 3)` of each volume."""
    edges = (artist for artist in drawn if isinstance(artist, Line3DCollection))
    return [np.array(each._segments3d[:2]) for each in edges]


def test_a_volume_is_a_cylinder_of_r_metres_about_its_centre_and_delta_up_and_down():
    drawn = draw_volumes({0: np.zeros(3)}, [volume()])
    ((low, high),) = rims(drawn)
    np.testing.assert_allclose(np.hypot(*(low - [1.0, 2.0, 0.0])[:, :2].T), 0.75)
    np.testing.assert_allclose(low[:, 2], np.degrees(0.5 - 0.4))
    np.testing.assert_allclose(high[:, 2], np.degrees(0.5 + 0.4))
    (ax,) = figure_of(drawn).axes
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()) == ("x / m", "y / m", "θ / °")
    assert not ax.texts


def test_volumes_of_other_nodes_are_carried_over_or_left_out(tmp_path):
    world = corridor()
    both = [volume(), volume(node=1)]
    first, second = rims(draw_volumes(assemble(world, 0), both))
    np.testing.assert_allclose(second - first, np.broadcast_to([SPACING, 0, 0], first.shape))
    assert len(rims(draw_volumes({1: np.zeros(3)}, both))) == 1
    figure = figure_of(draw_volumes(assemble(world, 0), both, named=True))
    figure.savefig(tmp_path / "volume.png", dpi=50)
    assert (tmp_path / "volume.png").read_bytes().startswith(b"\x89PNG")


def test_headings_are_drawn_within_half_a_turn_of_the_middle():
    poses = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]])
    np.testing.assert_allclose(in_degrees(poses)[:, 2], np.degrees([3.0, -3.0]))
    beyond = np.degrees([3.0, 2 * np.pi - 3.0])
    np.testing.assert_allclose(in_degrees(poses, 3.1)[:, 2], beyond)
    drawn = draw_volumes({0: np.zeros(3)}, [volume(pose=(0, 0, -3.0))], middle=3.1)
    assert np.mean(rims(drawn)[0][..., 2]) == pytest.approx(beyond[1])


def test_all_volumes_on_given_axes_are_in_sight_and_the_likelier_are_more_opaque():
    ax = Figure().add_subplot(projection="3d")
    drawn = draw_volumes({0: np.zeros(3)}, [volume(probability=0.9)], ax=ax)
    drawn += draw_volumes({0: np.zeros(3)}, [volume(pose=(6, 2, 0), probability=0.1)], ax=ax)
    assert all(artist.axes is ax for artist in drawn)
    points = np.concatenate(rims(drawn)).reshape(-1, 3)
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    assert np.all((points >= limits[:, 0] - 1e-9) & (points <= limits[:, 1] + 1e-9))
    likely, unlikely = (a for a in drawn if isinstance(a, Poly3DCollection))
    assert likely.get_alpha() > unlikely.get_alpha()


def test_x_and_y_have_one_scale():
    ax = Figure().add_subplot(projection="3d")
    show_box(ax, np.array([0.0, 0.0, -10.0]), np.array([6.0, 2.0, 10.0]))
    assert np.ptp(ax.get_xlim()) == pytest.approx(6.0)
    assert ax.get_ylim() == pytest.approx((-2.0, 4.0))
    assert ax.get_zlim() == pytest.approx((-10.0, 10.0))


def test_symbols_stand_at_what_they_mean_where_they_are_asked_for():
    drawn = draw_volumes({0: np.zeros(3)}, [volume()], named=True)
    named = {text.get_text().strip() for text in figure_of(drawn).axes[0].texts}
    assert named == {"$c_i$", "$r_i$", r"$\Delta_i$"}


def test_nothing_to_draw_leaves_empty_axes():
    ax = Figure().add_subplot(projection="3d")
    assert draw_volumes({}, [volume()], ax=ax) == []
    assert not ax.has_data()
