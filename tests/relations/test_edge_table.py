import jax
import numpy as np
import pytest

from aprjax.relations import edge_table
from aprjax.relations.edge_table import EdgeTable, Geometry, blocks_of
from aprjax.relations.index_table import IndexTable
from tests.relations.graphs import graph, scattered, stacked

COUNTS = [16, 0, 9, 3, 1, 2, 16, 0]
POINTS = [scattered(40 + k, count) for k, count in enumerate(COUNTS)]
EDGES = [count * (count - 1) // 2 for count in COUNTS]
MANY = 30  # references, in blocks of at most seven
windows = jax.jit(EdgeTable.windows)


@pytest.fixture(scope="module")
def graphs():
    return stacked([jax.device_get(graph(xy)) for xy in POINTS])


@pytest.fixture(scope="module")
def many():
    return stacked([jax.device_get(graph(scattered(k, k % 17))) for k in range(MANY)])


@pytest.fixture
def small_blocks(monkeypatch):
    """Thirty references then are five blocks of six, 31 are five of seven and one half empty."""
    monkeypatch.setattr(edge_table, "_ROWS", 7)


@pytest.fixture(scope="module")
def table(graphs):
    return EdgeTable.build(graphs)


@pytest.fixture(scope="module")
def definition(graphs):
    return IndexTable.build(graphs.length, graphs.valid)


def test_edges_come_in_the_order_of_the_index_table(table, definition):
    count = sum(EDGES)
    assert table.length.shape[0] == 1
    np.testing.assert_array_equal(table.length[0, :count], definition.length)
    np.testing.assert_array_equal(table.row[0, :count], definition.reference)


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("rows", [29, 30])
def test_each_block_of_references_has_the_index_table_of_these(many, rows):
    many = jax.tree.map(lambda array: array[:rows], many)
    table, (blocks, height) = EdgeTable.build(many), (5, 6)
    assert table.length.shape == (blocks, 120 * height)
    for block in range(blocks):
        here = slice(block * height, (block + 1) * height)
        wanted = IndexTable.build(many.length[here], many.valid[here])
        count = len(wanted.length)
        np.testing.assert_array_equal(table.length[block, :count], wanted.length)
        np.testing.assert_array_equal(table.row[block, :count], wanted.reference)
        assert np.isposinf(table.length[block, count:]).all()


@pytest.mark.parametrize("rows", [1, 8, 255, 256, 257, 3072, 70_000])
@pytest.mark.parametrize("anchors", [2, 16, 64, 128])
def test_blocks_hold_all_references_evenly_and_32_bits_number_their_pairs(rows, anchors):
    edges = anchors * (anchors - 1) // 2
    blocks, height = blocks_of(rows, edges)
    assert height == -(-rows // blocks) <= 256
    if anchors <= 64:
        assert blocks == -(-rows // 256)
    assert 2 * edges * (edges * height) <= np.iinfo(np.int32).max


def test_each_edge_has_its_middle_and_its_direction_in_half_a_turn(table, definition, graphs):
    edge = Geometry(*table.geometry[:, 0])
    for k, (row, (a, b)) in enumerate(zip(definition.reference, definition.ends, strict=True)):
        p, q = np.float64(graphs.xy[row, [a, b]])
        np.testing.assert_allclose((edge.x[k], edge.y[k]), (p + q) / 2, atol=1e-5)
        direction = np.arctan2(*(q - p)[::-1]) % np.pi
        np.testing.assert_allclose(edge.direction[k], direction, atol=1e-5)
        unit = np.cos(direction), np.sin(direction)
        np.testing.assert_allclose((edge.cos[k], edge.sin[k]), unit, atol=1e-5)


@pytest.mark.parametrize("tolerance", [0.0, 0.09, 0.5])
def test_windows_are_those_of_the_index_table(table, definition, tolerance):
    lengths = np.float32([0, 3, definition.length[5], definition.length[-1], 99, 1e30])
    begin, end = windows(table, lengths, np.float32(tolerance))
    for length, first, last in zip(lengths, begin[0], end[0], strict=True):
        # The bounds in float32, as on the device.
        low, high = length - np.float32(tolerance), length + np.float32(tolerance)
        wanted = np.flatnonzero((definition.length >= low) & (definition.length <= high))
        np.testing.assert_array_equal(np.arange(first, last), wanted)
        near = definition.near(length, tolerance)
        assert len(set(near.tolist()) ^ set(wanted.tolist())) <= (tolerance > 0) * 2


FULL = stacked([jax.device_get(graph(scattered(k, 16))) for k in range(8)])  # no slot is padding
PAIR = stacked([jax.device_get(graph(scattered(0, 2), slots=2))])  # a single slot


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("tolerance", [0.0, 0.1])
@pytest.mark.parametrize("which", ["many", "full", "pair"])
def test_windows_of_every_block_are_those_of_bisection(many, which, tolerance):
    graphs = {"many": many, "full": FULL, "pair": PAIR}[which]
    table, tolerance = EdgeTable.build(graphs), np.float32(tolerance)
    lengths = np.unique(np.r_[table.length[np.isfinite(table.length)], np.float32([0, 50])])
    begin, end = windows(table, lengths, tolerance)
    for block, length in enumerate(table.length):
        low, high = lengths - tolerance, lengths + tolerance
        np.testing.assert_array_equal(begin[block], np.searchsorted(length, low, "left"))
        np.testing.assert_array_equal(end[block], np.searchsorted(length, high, "right"))


def test_padding_is_infinitely_long_and_in_no_window(table):
    count = sum(EDGES)
    assert np.isposinf(table.length[0, count:]).all()
    for leaf in jax.tree.leaves(table):
        assert leaf.shape[-1] == len(COUNTS) * 120
    assert np.isfinite(table.geometry).all()
    _, end = windows(table, np.float32([1e6]), np.float32(1e9))
    assert end[0, 0] == count


def test_references_without_edges_have_no_row_in_the_table(table):
    held = np.bincount(np.asarray(table.row)[0, : sum(EDGES)], minlength=len(COUNTS))
    assert held.tolist() == EDGES


def test_graphs_without_any_edge_make_a_table_of_padding():
    nothing = EdgeTable.build(stacked([jax.device_get(graph(np.zeros((0, 2))))] * 8))
    assert np.isposinf(nothing.length).all()
    begin, end = windows(nothing, np.float32([0, 3]), np.float32(0.5))
    assert (begin == end).all()


def test_padding_of_the_anchors_filled_with_nan_changes_nothing(graphs, table):
    other = stacked([jax.device_get(graph(xy, fill=np.nan)) for xy in POINTS])
    for ours, theirs in zip(
        jax.tree.leaves(table), jax.tree.leaves(EdgeTable.build(other)), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("rows", [1, 8, 29, 30])
def test_the_traced_table_is_the_one_of_the_host(many, rows):
    graphs = jax.tree.map(lambda array: array[:rows], many)
    one, other = EdgeTable.build(graphs), jax.jit(EdgeTable.of)(graphs)
    np.testing.assert_array_equal(one.length, other.length)
    np.testing.assert_array_equal(one.row, other.row)
    np.testing.assert_allclose(one.geometry, other.geometry, atol=1e-6)
