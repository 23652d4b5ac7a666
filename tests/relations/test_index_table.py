import numpy as np
import pytest

from aprjax.relations.index_table import IndexTable
from tests.oracles import relations as oracle
from tests.relations.graphs import graph, scattered, stacked

COUNTS = [16, 9, 5, 3, 2, 1, 0]
POINTS = [scattered(k, count) for k, count in enumerate(COUNTS)]
LENGTHS = [
    [edge[2] for edge in oracle.edges(xy, np.ones(len(xy), bool))] for xy in POINTS
]  # float64


@pytest.fixture(scope="module")
def table():
    # Lengths of the loop, so that both sides compare the same numbers.
    length, valid = np.zeros((7, 16, 16)), np.zeros((7, 16, 16), bool)
    for k, xy in enumerate(POINTS):
        for a, b, d, _ in oracle.edges(xy, np.ones(len(xy), bool)):
            length[k, a, b] = length[k, b, a] = d
            valid[k, a, b] = valid[k, b, a] = True
    return IndexTable.build(length, valid)


def test_the_table_holds_every_edge_once_sorted_by_length(table):
    assert (np.diff(table.length) >= 0).all()
    assert table.edges.tolist() == [n * (n - 1) // 2 for n in COUNTS]
    rows = {
        (int(n), int(a), int(b)): d
        for n, (a, b), d in zip(table.reference, table.ends, table.length, strict=True)
    }
    assert len(rows) == len(table.length) == table.edges.sum()
    for k, xy in enumerate(POINTS):
        for a, b, d, _ in oracle.edges(xy, np.ones(len(xy), bool)):
            assert rows[k, a, b] == d


@pytest.mark.parametrize("tolerance", [0.0, 0.1, 0.5])
def test_near_rows_are_all_rows_within_the_tolerance(table, tolerance):
    for length in (0.0, 3.0, table.length[5], table.length[-1], 99.0):
        wanted = np.flatnonzero(np.abs(table.length - length) <= tolerance)
        np.testing.assert_array_equal(table.near(length, tolerance), wanted)


@pytest.mark.parametrize("tolerance", [0.05, 0.3])
@pytest.mark.parametrize("query", range(len(COUNTS)))
def test_counts_and_qualities_equal_the_double_loop(table, query, tolerance):
    counts = [oracle.count(LENGTHS[query], lengths, tolerance) for lengths in LENGTHS]
    assert table.counts(LENGTHS[query], tolerance).tolist() == counts
    wanted = [
        oracle.quality(count, len(LENGTHS[query]), len(lengths))
        for count, lengths in zip(counts, LENGTHS, strict=True)
    ]
    np.testing.assert_allclose(table.quality(LENGTHS[query], tolerance), wanted)


def test_a_graph_of_distinct_lengths_has_quality_one_with_itself(table):
    assert table.quality(LENGTHS[2], 1e-9)[2] == 1


def test_a_table_of_graphs_of_the_engine_has_their_edges():
    graphs = stacked([graph(xy) for xy in POINTS])
    table = IndexTable.build(graphs.length, graphs.valid)
    assert table.edges.tolist() == [int(k) for k in graphs.edges]


def test_an_empty_table_counts_nothing():
    table = IndexTable.build(np.zeros((2, 4, 4)), np.zeros((2, 4, 4), bool))
    assert table.counts([1.0, 2.0], 0.5).tolist() == [0, 0]
    assert table.quality([], 0.5).tolist() == [0, 0]
