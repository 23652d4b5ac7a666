import struct

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import Anchors
from aprjax.plot.alignment import draw_correspondences, draw_matching_angles
from aprjax.plot.anchors import draw_anchors
from aprjax.plot.match import draw_match
from aprjax.plot.scan import draw_scan
from aprjax.plot.style import figure_of
from aprjax.references import ReferenceSet
from aprjax.relations.graph import anchor_graph
from aprjax.scan import Scan
from tests.worlds import scan_at


def box(x, y, width, height):
    corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


ROOM = np.concatenate([box(0, 0, 8, 6), box(6, 2, 0.8, 0.8), box(4, 4.5, 0.1, 0.1)])
NAMES = {kind: kind.name.lower().replace("_", " ") for kind in Kind}
HERE = np.array([1.0, 3.0, 0.0])


@pytest.fixture(scope="module")
def scan():
    return scan_at(ROOM, HERE)


@pytest.fixture(scope="module")
def anchors(scan) -> Anchors:
    return anchors_of(scan)


def anchors_of(scan) -> Anchors:
    # By way of a set, whose compilation other tests need too.
    found = ReferenceSet.build([scan]).index.features.anchors
    return jax.tree.map(lambda array: array[0], found)


@pytest.fixture(scope="module")
def nothing():
    return Scan.make(np.full(181, np.nan), angle_min=-1.5, angle_increment=0.017, range_max=9.0)


def png_size(figure, path, dpi=50):
    figure.savefig(path, dpi=dpi)
    data = path.read_bytes()
    assert data.startswith(b"\x89PNG")
    return struct.unpack(">II", data[16:24])


def labels_of(ax):
    return {text.get_text() for text in ax.get_legend().get_texts()}


def test_a_scan_with_its_anchors_over_it(scan, anchors, tmp_path):
    drawn = draw_scan(scan)
    figure = figure_of(drawn)
    (ax,) = figure.axes
    assert labels_of(ax) == {"large parts", "small objects, removed", "laser"}
    limits = ax.get_xlim()
    over = draw_anchors(anchors, ax=ax)
    assert ax.get_xlim() == limits
    count = int(anchors.valid.sum())
    assert count >= 3
    assert ax.get_title() == f"{count} anchor points"
    assert sum(len(points.get_offsets()) for points in over) == count
    kinds = {NAMES[kind] for kind in np.asarray(anchors.kind)[np.asarray(anchors.valid)]}
    assert {"large parts", "small objects, removed", "laser"} | kinds == labels_of(ax)
    assert ax.get_aspect() == 1.0
    png_size(figure, tmp_path / "figure.png")


def test_the_graph_has_a_line_for_each_pair_of_anchors(anchors):
    drawn = draw_anchors(anchors, anchor_graph(anchors))
    count = int(anchors.valid.sum())
    edges = count * (count - 1) // 2
    assert len(drawn[0].get_segments()) == edges
    (ax,) = figure_of(drawn).axes
    assert ax.get_title() == f"{count} anchor points, {edges} edges"


def test_each_kind_has_its_own_entry_in_the_legend():
    xy = np.array([[1, 0], [2, 0], [3, 0]], np.float32)
    three = Anchors(xy, np.arange(3), np.ones(3), np.ones(3, bool), np.int32(0))  # type: ignore
    (ax,) = figure_of(draw_anchors(three)).axes
    assert set(NAMES.values()) <= labels_of(ax)


def test_what_is_drawn_is_what_given_axes_gained(scan, anchors):
    left, right = Figure(figsize=(4, 6)).subplots(2)
    drawn = draw_scan(scan, ax=left) + draw_anchors(anchors, ax=left)
    assert {artist.axes for artist in drawn} == {left}
    assert set(drawn) == {*left.collections, *left.lines}
    assert not right.has_data()


def test_an_artist_that_is_in_no_figure_has_none():
    with pytest.raises(ValueError, match="no figure"):
        figure_of([Line2D([], [])])
    with pytest.raises(ValueError, match="no artists"):
        figure_of([])


def test_a_scan_without_anything(nothing, tmp_path):
    none = anchors_of(nothing)
    for name, drawn in (
        ("scan", draw_scan(nothing)),
        ("anchors", draw_anchors(none, anchor_graph(none))),
        ("match", draw_match(nothing, nothing, np.zeros(3))),
        ("angles", draw_matching_angles(anchor_graph(none), anchor_graph(none))),
        ("matrix", draw_correspondences(anchor_graph(none), anchor_graph(none), 0.0)),
    ):
        png_size(figure_of(drawn), tmp_path / f"{name}.png")


def test_two_scans_lie_over_each_other_in_the_frame_of_the_reference(scan, tmp_path):
    T_ref_query = np.array([1.0, -0.5, np.radians(20)])
    query = scan_at(ROOM, HERE + T_ref_query)
    figure = figure_of(draw_match(scan, query, T_ref_query, quality=0.876))
    (ax,) = figure.axes
    assert ax.get_title() == "e_m 0.88; x 1.00 m, y -0.50 m, θ 20.0°"
    points = {c.get_label(): np.asarray(c.get_offsets()) for c in ax.collections}
    for name in ("reference", "query", "synthetic, from the reference"):
        # In the room's frame all of them lie on its walls, the outer ones or a box's.
        xy = points[name] + HERE[:2]
        assert len(xy) > 50
        assert np.all(on_walls(xy))
    width, height = png_size(figure, tmp_path / "match.png")
    assert width == 400
    assert 150 < height < 500


def on_walls(xy):
    start, along = ROOM[:, 0], ROOM[:, 1] - ROOM[:, 0]
    share = np.einsum("psd,sd->ps", xy[:, None] - start, along) / (along**2).sum(axis=1)
    nearest = start + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(xy[:, None] - nearest, axis=-1).min(axis=1) < 0.06


def test_the_synthetic_scan_is_from_the_scan_that_sees_the_other(scan):
    behind = np.array([-0.6, 0.2, 0.0])
    figure = figure_of(draw_match(scan, scan_at(ROOM, HERE + behind), behind))
    assert "synthetic, from the query" in labels_of(figure.axes[0])
    assert not figure.axes[0].get_title().startswith("e_m")


def test_a_match_is_drawn_into_given_axes(scan):
    ax = Figure().subplots()
    drawn = draw_match(scan, scan, np.zeros(3), ax=ax)
    assert {artist.axes for artist in drawn} == {ax}


TURN = np.radians(50)


@pytest.fixture(scope="module")
def graphs():
    """A graph of four anchors, and the same seen by a laser that is turned by `TURN`."""
    xy = np.array([[2.0, 0.3], [3.1, 2.0], [-0.7, 2.9], [0.4, -2.2]], np.float32)
    cos, sin = np.cos(TURN), np.sin(TURN)
    there = xy @ np.array([[cos, -sin], [sin, cos]], np.float32)
    return tuple(anchor_graph(graph_of(points)) for points in (xy, there))


def graph_of(xy) -> Anchors:
    padded = np.pad(xy.astype(np.float32), [(0, 12), (0, 0)])
    zeros, valid = np.zeros(16, np.int32), np.arange(16) < 4
    return jax.tree.map(jax.numpy.asarray, Anchors(padded, zeros, zeros, valid, zeros[0]))  # type: ignore


def test_the_highest_bar_of_the_matching_angles_is_at_the_true_rotation(graphs):
    drawn = draw_matching_angles(*graphs)
    (ax,) = figure_of(drawn).axes
    highest = max(ax.patches, key=lambda bar: bar.get_height())
    assert highest.get_height() >= 4
    assert highest.get_x() - 3.1 <= 50 <= highest.get_x() + highest.get_width() + 3.1
    assert any(abs(line.get_xdata()[0] - 50) < 3 for line in ax.lines)
    assert ax.get_xlim() == (0, 180)


def test_the_true_anchor_pairs_are_the_darkest_of_the_correspondence_matrix(graphs):
    drawn = draw_correspondences(*graphs, TURN)
    matrix = np.asarray(drawn[0].get_array())
    assert matrix.shape == (4, 4)
    np.testing.assert_array_equal(np.diag(matrix), 3)
    assert np.all(matrix - np.diag(np.diag(matrix)) < 3)
    (ax,) = figure_of(drawn).axes
    assert sum(text.get_text() == "3" for text in ax.texts) == 4
