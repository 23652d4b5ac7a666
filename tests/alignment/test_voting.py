import jax
import numpy as np
import pytest

from aprjax.alignment.voting import VotingConfig, vote
from aprjax.relations import edge_table
from aprjax.relations.edge_table import EdgeTable
from tests.oracles import voting as oracle
from tests.oracles.alignment import apart
from tests.oracles.evaluation import compose, error, inverse
from tests.oracles.relations import edges
from tests.relations.graphs import graph, moved, scattered, stacked

COUNTS = [16, 9, 0, 7, 12, 1, 16, 2]
POINTS = [scattered(60 + k, count) for k, count in enumerate(COUNTS)]
GRAPHS = [(xy, np.ones(len(xy), bool)) for xy in POINTS]
ALL = np.ones(len(COUNTS), bool)
POSES = [(1.0, -2.0, 0.5), (-4.0, 0.3, -2.9), (0.0, 0.0, 0.0), (2.0, 2.0, 3.1)]
# So many counters that no two cells of these graphs share one.
DEEP = VotingConfig(depth=4096)

votes_of = jax.jit(vote)


class References:
    """Some graphs, and what `vote` needs of them."""

    def __init__(self, points):
        graphs = stacked([jax.device_get(graph(xy)) for xy in points])
        self.table = EdgeTable.build(graphs)
        self.k_m = np.asarray(graphs.edges).astype(np.float32)

    def votes(self, query, allowed=None, config=None):
        allowed = np.ones(len(self.k_m), bool) if allowed is None else allowed
        config = VotingConfig() if config is None else config
        return jax.device_get(votes_of(self.table, self.k_m, allowed, query, config))


@pytest.fixture(scope="module")
def references():
    return References(POINTS)


def listed(votes, names=None):
    """The valid votes in an order that does not depend on that of the references."""
    row = votes.row if names is None else names[votes.row]
    rows = np.column_stack([row, votes.count, votes.rating, votes.T_ref_query])[votes.valid]
    return rows[np.lexsort(np.round(rows.T, 3))]


def partly_seen(seed=0):
    """Seven anchors of reference 0 and five others, from elsewhere."""
    rng = np.random.default_rng(seed)
    seen = moved(inverse(POSES[1]), POINTS[0][:7]) + rng.normal(0, 0.02, (7, 2))
    return np.concatenate([seen, rng.uniform(-6, 6, (5, 2))]).astype(np.float32)


@pytest.fixture(scope="module")
def counted():
    """The dictionary of cells of one query."""
    xy = partly_seen()
    query = xy, np.ones(len(xy), bool)
    return oracle.cells(GRAPHS, query, DEEP), oracle.centre(query)


@pytest.fixture(scope="module")
def deep(references):
    return references.votes(graph(partly_seen()), config=DEEP)


def cell_in(cells, votes, middle, k):
    """Those who voted for the cell of vote k: of the grid where they are as many as it counts."""
    for grid in range(DEEP.grids):
        exact = oracle.cell_of(np.float64(votes.T_ref_query[k]), middle, grid, DEEP)
        # In float32 a pose may lie on the other side of a border.
        for off in (-1e-4, 1e-4):
            cell = tuple(np.floor(exact + off).astype(int))
            found = cells.get((int(votes.row[k]), grid, cell), [])
            if len(found) == votes.count[k]:
                return found
    return None


def test_each_count_is_that_of_a_cell_in_the_dictionary(deep, counted):
    cells, middle = counted
    assert deep.valid.sum() > 100
    missing = [k for k in np.flatnonzero(deep.valid) if cell_in(cells, deep, middle, k) is None]
    # A pair at a border votes for either cell.
    assert len(missing) <= 0.01 * deep.valid.sum()


def test_the_pose_is_that_of_the_longest_edge_in_the_cell(deep, counted):
    cells, middle = counted
    for k in np.argsort(-deep.rating, kind="stable")[:100]:
        found = cell_in(cells, deep, middle, k)
        if found is None:  # a pair at a border
            continue
        length = max(length for length, _ in found)
        gaps = [error(deep.T_ref_query[k], T) for e, T in found if e == length]
        assert min(max(gap) for gap in gaps) < 1e-4


def test_ratings_are_the_counts_over_the_geometric_mean_of_the_edges(deep):
    k_act = len(edges(partly_seen(), np.ones(12, bool)))
    k_m = np.array([n * (n - 1) // 2 for n in COUNTS])
    valid = deep.valid
    wanted = deep.count[valid] / np.sqrt(k_act * k_m[deep.row[valid]])
    np.testing.assert_allclose(deep.rating[valid], wanted, rtol=1e-5)


def test_the_best_cell_of_every_reference_is_kept(deep, counted):
    cells, _ = counted
    for row in range(len(COUNTS)):
        most = max((len(found) for (other, *_), found in cells.items() if other == row), default=0)
        assert max(deep.count[deep.valid & (deep.row == row)], default=0) == most


@pytest.mark.parametrize("poses", [1, 3])
def test_of_each_part_so_many_are_kept_over_all_references_best_rated_first(
    references, deep, poses
):
    fewer = references.votes(graph(partly_seen()), config=VotingConfig(depth=4096, poses=poses))
    wanted = -np.sort(-deep.rating.reshape(DEEP.places, -1), axis=1)[:, :poses]
    np.testing.assert_array_equal(fewer.rating.reshape(DEEP.places, poses), wanted)


@pytest.mark.parametrize("pose", POSES)
def test_a_moved_copy_of_a_reference_gets_the_true_pose_and_the_votes_of_all_its_edges(
    references, pose
):
    for row in (0, 4, 1):
        found = references.votes(graph(moved(inverse(pose), POINTS[row])))
        best = np.argmax(found.rating)
        assert found.valid[best]
        assert found.row[best] == row
        assert found.count[best] >= references.k_m[row]
        assert found.rating[best] >= 1
        distance, angle = error(found.T_ref_query[best], pose)
        assert distance < 2e-3
        assert angle < 2e-3


@pytest.mark.parametrize("turn", [0.4, -1.3, 3.0])
def test_turning_the_query_turns_its_pose(references, turn):
    xy = moved(inverse(POSES[0]), POINTS[4])
    straight, turned = (references.votes(graph(points)) for points in (xy, moved((0, 0, turn), xy)))
    first, second = np.argmax(straight.rating), np.argmax(turned.rating)
    assert straight.row[first] == turned.row[second] == 4
    expected = compose(straight.T_ref_query[first], (0, 0, -turn))
    distance, angle = error(turned.T_ref_query[second], expected)
    assert distance < 2e-3
    assert angle < 2e-3


def test_turning_the_query_by_whole_cells_changes_no_count(references, deep):
    """The cells are then the same, but for their numbers."""
    turned = moved((0, 0, 7 * 2 * np.pi / DEEP.directions), partly_seen())
    found = references.votes(graph(turned), config=DEEP)
    for row in range(len(COUNTS)):
        most, other = (max(v.count[v.valid & (v.row == row)], default=0) for v in (deep, found))
        assert most == other


def test_permuting_the_references_permutes_the_rows_and_nothing_else(references):
    order = np.random.default_rng(3).permutation(len(COUNTS))
    query = graph(partly_seen())
    found = References([POINTS[k] for k in order]).votes(query)
    np.testing.assert_allclose(listed(found, order), listed(references.votes(query)), atol=1e-5)


def test_rows_of_padding_change_nothing(references):
    query = graph(partly_seen())
    padded = References([*POINTS, np.zeros((0, 2)), np.zeros((0, 2))])
    allowed = np.append(ALL, [False, False])
    np.testing.assert_allclose(
        listed(padded.votes(query, allowed)), listed(references.votes(query)), atol=1e-5
    )


MANY = [scattered(k, 2 + k % 15) for k in range(29)]
QUERIES = [
    moved(inverse(POSES[0]), np.concatenate([MANY[14], MANY[27]])[:14]),
    partly_seen(),
    scattered(1, 1),
]


def in_blocks(monkeypatch, rows):
    """Twenty-nine references, so many in a block at most."""
    monkeypatch.setattr(edge_table, "_ROWS", rows)
    return References(MANY)


@pytest.mark.parametrize("poses", [3, 64])
def test_votes_do_not_depend_on_the_blocks_that_references_are_in(monkeypatch, poses):
    config = VotingConfig(poses=poses)
    whole, blocks = in_blocks(monkeypatch, 256), in_blocks(monkeypatch, 7)
    assert whole.table.length.shape == (1, 29 * 120)
    assert blocks.table.length.shape == (5, 6 * 120)  # of which the last has room for one more
    for xy in QUERIES:
        one, other = (each.votes(graph(xy), config=config) for each in (whole, blocks))
        jax.tree.map(np.testing.assert_array_equal, one, other)


def test_queries_that_vote_together_get_what_each_gets_by_itself(monkeypatch):
    references = in_blocks(monkeypatch, 7)
    graphs = [jax.device_get(graph(xy)) for xy in QUERIES]
    allowed = np.ones(len(MANY), bool)
    together = jax.jit(jax.vmap(vote, (None, None, None, 0, None)))
    found = together(references.table, references.k_m, allowed, stacked(graphs), VotingConfig())
    for k, query in enumerate(graphs):
        wanted = references.votes(query)
        np.testing.assert_array_equal(found.row[k], wanted.row)
        np.testing.assert_array_equal(found.count[k], wanted.count)
        np.testing.assert_allclose(found.rating[k], wanted.rating, rtol=1e-6)
        np.testing.assert_allclose(found.T_ref_query[k], wanted.T_ref_query, atol=1e-5)


def test_edges_that_a_query_does_not_have_vote_for_none(references):
    """Not even where edges of no length correspond to those that are there."""
    config = VotingConfig(length=3.0)
    four, slots = scattered(2, 4), jax.device_get(graph(scattered(2, 4)))
    found = references.votes(slots, config=config)
    counted = oracle.cells(GRAPHS, (four, np.ones(4, bool)), config)
    assert 0 < found.count.sum() <= sum(map(len, counted.values()))


def test_padding_of_the_query_filled_with_nan_changes_nothing(references):
    clean, spoiled = (graph(partly_seen(), fill=fill) for fill in (0.0, np.nan))
    np.testing.assert_array_equal(
        listed(references.votes(spoiled)), listed(references.votes(clean))
    )


def test_references_that_are_not_allowed_get_no_vote_and_the_others_keep_theirs(references):
    query = graph(partly_seen())
    allowed = ALL & (np.arange(len(COUNTS)) % 3 != 0)
    found = references.votes(query, allowed)
    assert found.valid.any()
    assert allowed[found.row[found.valid]].all()
    everything = listed(references.votes(query))
    np.testing.assert_array_equal(listed(found), everything[allowed[everything[:, 0].astype(int)]])


@pytest.mark.parametrize("count", [0, 1])
def test_a_query_without_edges_gets_no_votes_and_zero_poses(references, count):
    found = references.votes(graph(scattered(1, count)))
    assert not found.valid.any()
    assert not found.rating.any()
    assert not found.T_ref_query.any()


def test_an_edge_on_an_edge_gives_both_senses(references):
    """Two anchors cannot tell a place from its half turn."""
    query = graph(moved(inverse(POSES[0]), POINTS[7]))
    found = references.votes(query, np.arange(len(COUNTS)) == 7)
    turns = found.T_ref_query[found.valid, 2]
    assert min(apart(turn, POSES[0][2], 2 * np.pi) for turn in turns) < 1e-3
    assert min(apart(turn, POSES[0][2] + np.pi, 2 * np.pi) for turn in turns) < 1e-3
    assert (found.count[found.valid] == 1).all()


def test_more_votes_than_16_bits_hold_are_counted():
    """As many anchors as a scan may have, close together, on a copy of themselves."""
    xy = scattered(5, 128, size=1.2)
    of = jax.device_get(graph(xy, slots=128))
    references = stacked([of])
    k_m = np.asarray(references.edges).astype(np.float32)
    found = votes_of(EdgeTable.build(references), k_m, np.ones(1, bool), of, VotingConfig())
    assert found.count.max() > np.iinfo(np.int16).max
    assert found.count.min() >= 0


@pytest.mark.parametrize("name", ["places", "depth"])
@pytest.mark.parametrize("value", [0, 3, 48])
def test_numbers_of_counters_that_are_no_power_of_two_are_refused(name, value):
    with pytest.raises(ValueError, match=f"{name}: {value}"):
        VotingConfig(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"), [("directions", 39), ("directions", 0), ("grids", 0), ("poses", 0)]
)
def test_other_bad_capacities_are_refused_by_name_and_value(name, value):
    with pytest.raises(ValueError, match=f"{name}: {value}"):
        VotingConfig(**{name: value})


def test_no_threshold_compiles_anew(references):
    query = graph(partly_seen())
    references.votes(query)
    before = votes_of._cache_size()
    for value in (0.05, 0.2, np.float64(0.3)):
        references.votes(query, config=VotingConfig(length=value, cell=2 * value))
    assert votes_of._cache_size() == before
