import struct

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import Anchors
from aprjax.plot.anchors import draw_anchors
from aprjax.plot.match import draw_match
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


def test_the_scan_is_drawn_to_the_left_and_the_graph_to_the_right(scan, anchors, tmp_path):
    figure = draw_anchors(scan, anchors)
    left, right = figure.axes
    count = int(anchors.valid.sum())
    edges = count * (count - 1) // 2
    assert count >= 3
    assert left.get_title() == f"Scan with {count} anchor points"
    assert right.get_title() == f"Anchor point graph with {edges} edges"
    assert max(len(c.get_paths()) for c in right.collections) == edges
    kinds = {NAMES[kind] for kind in np.asarray(anchors.kind)[np.asarray(anchors.valid)]}
    assert {"large parts", "small objects, removed", "laser"} | kinds == labels_of(left)
    assert left.get_aspect() == right.get_aspect() == 1.0
    assert png_size(figure, tmp_path / "figure.png") == (550, 250)


def test_each_kind_has_its_own_entry_in_the_legend(scan):
    xy = np.array([[1, 0], [2, 0], [3, 0]], np.float32)
    three = Anchors(xy, np.arange(3), np.ones(3), np.ones(3, bool), np.int32(0))  # type: ignore
    figure = draw_anchors(scan, three, anchor_graph(three))
    assert set(NAMES.values()) <= labels_of(figure.axes[0])


def test_axes_that_are_given_are_used(scan, anchors, tmp_path):
    figure = Figure(figsize=(4, 6))
    rows = figure.subplots(2, 2)
    assert draw_anchors(scan, anchors, ax=tuple(rows[1])) is figure
    assert not rows[0, 0].has_data()
    assert rows[1, 0].has_data()
    assert rows[1, 1].has_data()
    assert png_size(figure, tmp_path / "figure.png") == (200, 300)


def test_a_scan_without_anything(nothing, tmp_path):
    png_size(draw_anchors(nothing, anchors_of(nothing)), tmp_path / "a.png")
    png_size(draw_match(nothing, nothing, np.zeros(3)), tmp_path / "m.png")


def test_two_scans_lie_over_each_other_in_the_frame_of_the_reference(scan, tmp_path):
    T_ref_query = np.array([1.0, -0.5, np.radians(20)])
    query = scan_at(ROOM, HERE + T_ref_query)
    figure = draw_match(scan, query, T_ref_query, quality=0.876)
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
    figure = draw_match(scan, scan_at(ROOM, HERE + behind), behind)
    assert "synthetic, from the query" in labels_of(figure.axes[0])
    assert not figure.axes[0].get_title().startswith("e_m")


def test_a_match_is_drawn_into_given_axes(scan):
    figure = Figure()
    ax = figure.subplots()
    assert draw_match(scan, scan, np.zeros(3), ax=ax) is figure
    assert ax.has_data()
