import struct

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.figure import Figure

from aprjax.plot.map import draw_map
from aprjax.plot.style import figure_of
from aprjax.sim.world import World

ROOM = [[[0, 0], [8, 0]], [[8, 0], [8, 5]], [[8, 5], [0, 5]], [[0, 5], [0, 0]]]
WORLD = World.make(ROOM, [[2, 4, 0.3], [5, 4, 0.02], [0, 0, 0]])
REFERENCES = np.array([[1.0, 1.0, 0.0], [7.0, 1.0, np.pi / 2]])
COURSE = np.stack([np.linspace(1, 7, 13), np.full(13, 2.0), np.zeros(13)], axis=-1)
CORRECT = np.isin(np.arange(13), [0, 1, 3, 4, 5, 9])
FALSE = np.arange(13) == 7


@pytest.fixture
def figure():
    return figure_of(draw_map(WORLD, REFERENCES, COURSE, CORRECT, FALSE))


def artists(figure, kind):
    return [artist for artist in figure.axes[0].collections if isinstance(artist, kind)]


def triangles(figure):
    """The corners `(triangles, 3, 2)` of the correct and of the false estimates."""
    return [
        np.array([path.vertices[:3] for path in each.get_paths()]).reshape(-1, 3, 2)
        for each in artists(figure, PolyCollection)
    ]


def lines(figure):
    """Both ends `(lines, 2, 2)` of the plan's walls, the references' ticks and the gaps."""
    return [np.reshape(each.get_segments(), (-1, 2, 2)) for each in artists(figure, LineCollection)]


def test_each_estimate_is_a_triangle_around_its_place_that_points_ahead(figure):
    correct, false = triangles(figure)
    assert len(correct) == 6
    assert len(false) == 1
    for corners, pose in zip([*correct, *false], [*COURSE[CORRECT], *COURSE[FALSE]], strict=True):
        assert np.hypot(*(corners.mean(axis=0) - pose[:2])) < 0.1
        tip = corners[np.argmax(np.hypot(*(corners - pose[:2]).T))] - pose[:2]
        assert np.arctan2(tip[1], tip[0]) == pytest.approx(pose[2], abs=1e-6)


def test_triangles_turn_with_the_heading():
    poses = np.stack([COURSE[:, 0], COURSE[:, 1], np.linspace(-3, 3, 13)], axis=-1)
    drawn = draw_map(WORLD, REFERENCES, poses, np.full(13, True), np.full(13, False))
    correct, _ = triangles(figure_of(drawn))
    tips = correct[:, 0] - poses[:, :2]
    np.testing.assert_allclose(np.arctan2(tips[:, 1], tips[:, 0]), poses[:, 2], atol=1e-6)


def test_false_estimates_are_black_and_correct_ones_grey(figure):
    grey, black = (each.get_facecolor()[0, :3] for each in artists(figure, PolyCollection))
    np.testing.assert_allclose(black, 0)
    assert np.ptp(grey) == 0
    assert 0.3 < grey[0] < 0.7


def test_lines_bridge_what_has_no_match(figure):
    gaps = lines(figure)[-1]
    np.testing.assert_allclose(gaps, COURSE[[[1, 3], [5, 9]], :2])


def test_the_plan_and_the_references_are_there(figure):
    walls, ticks, _ = lines(figure)
    np.testing.assert_allclose(walls, ROOM)
    np.testing.assert_allclose(ticks[:, 0], REFERENCES[:, :2])
    ahead = ticks[:, 1] - ticks[:, 0]
    np.testing.assert_allclose(np.arctan2(ahead[:, 1], ahead[:, 0]), REFERENCES[:, 2], atol=1e-6)
    (round_things,) = artists(figure, EllipseCollection)
    np.testing.assert_allclose(round_things.get_offsets(), [[2, 4], [5, 4]])


def test_the_axes_are_in_metres_of_one_scale_with_a_legend_outside(figure, tmp_path):
    (ax,) = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("x / m", "y / m", 1.0)
    assert ax.get_xlim() == (-0.5, 8.5)
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["reference scans (2)", "correct (6)", "false (1)", "no match between"]
    figure.savefig(tmp_path / "map.png", dpi=50)
    assert ax.get_legend().get_window_extent().y1 < ax.get_window_extent().y0
    data = (tmp_path / "map.png").read_bytes()
    assert struct.unpack(">II", data[16:24])[0] == 540


def test_a_run_without_any_match_and_an_empty_plan(tmp_path):
    nothing = np.full(13, False)
    figure = figure_of(draw_map(World.make(), REFERENCES, COURSE, nothing, nothing))
    assert [len(each) for each in triangles(figure)] == [0, 0]
    figure.savefig(tmp_path / "map.png", dpi=50)


def test_what_scans_saw_may_stand_for_the_plan(tmp_path):
    points = np.random.default_rng(0).uniform(0, 8, (50, 2))
    figure = figure_of(draw_map(points, REFERENCES, COURSE, CORRECT, FALSE))
    (ax,) = figure.axes
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), points)
    assert [len(each) for each in triangles(figure)] == [6, 1]
    assert ax.get_xlim() == pytest.approx((points[:, 0].min() - 0.5, points[:, 0].max() + 0.5))


def test_triangles_grow_with_the_floor():
    small, large = (
        triangles(figure_of(draw_map(size * np.eye(2), REFERENCES, COURSE, CORRECT, FALSE)))[0]
        for size in (20.0, 100.0)
    )
    across = [np.ptp(corners, axis=1).max() for corners in (small, large)]
    assert 3 < across[1] / across[0] < 6


def test_given_axes_are_used():
    ax = Figure().subplots()
    drawn = draw_map(WORLD, REFERENCES, COURSE, CORRECT, FALSE, ax=ax)
    assert {artist.axes for artist in drawn} == {ax}
