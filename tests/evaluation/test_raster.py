import jax
import numpy as np
import pytest

from aprjax.evaluation.raster import GlanceConfig, RasterConfig, glance, raster
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from tests.make_logs import _near
from tests.oracles import raster as oracle
from tests.oracles.evaluation import between, compose
from tests.worlds import free_pose, office, scan_at

PAIRS = 3
CONFIG, RULES = RasterConfig(), GlanceConfig()
BEAMS = np.arange(180)
# Of the 32 end points that are looked up, sixteen lie in either half, none near its ends.
HALF = (BEAMS >= 3) & (BEAMS < 93)

_draw = jax.jit(jax.vmap(raster, (0, None)))
_together = jax.jit(glance)


@jax.jit
def _glance(references, rows, queries, T_ref_query, ratings, config, rules):
    def one(row, query, T, rating):
        return glance(references, row[None], query, T[None], rating[None], config, rules)[0]

    return jax.vmap(one)(rows, queries, T_ref_query, ratings)


def draw(views):
    return jax.device_get(_draw(views, CONFIG))


def views_of(scans):
    return jax.device_get(ReferenceSet.build(scans).index.features.view)


def row(tree, index):
    return jax.tree.map(lambda array: array[index], tree)


def around(ranges):
    """A scan of a full turn with 180 beams."""
    ranges = np.broadcast_to(ranges, BEAMS.shape)
    return Scan.make(ranges, angle_min=-np.pi, angle_increment=np.pi / 90, range_max=50.0)


def glances(references, rows, queries, T_ref_query, rating=1.0, rules=RULES):
    """One for each row of `queries`."""
    ratings = np.full(len(rows), rating, np.float32)
    T = np.asarray(T_ref_query, np.float32)
    return np.asarray(_glance(references, np.int32(rows), queries, T, ratings, CONFIG, rules))


def one(reference, query, T_ref_query=(0, 0, 0), rating=1.0, rules=RULES):
    drawn = draw(views_of([reference, query]))
    # Eight times the same: one shape for all.
    queries = row(drawn, np.ones(8, int))
    return glances(drawn, np.zeros(8), queries, np.tile(T_ref_query, (8, 1)), rating, rules)[0]


@pytest.mark.parametrize("poses", [5, 8])
def test_poses_of_one_query_together_are_as_one_by_one(poses, pairs):
    _, drawn, T = pairs
    T = np.asarray(T, np.float32)
    which = np.arange(poses) % PAIRS
    ratings = np.full(poses, 2.0, np.float32)
    query = row(drawn, PAIRS)
    found = _together(drawn, np.int32(which), query, T[which], ratings, CONFIG, RULES)
    queries = row(drawn, np.full(poses, PAIRS))
    np.testing.assert_array_equal(found, glances(drawn, which, queries, T[which], 2.0))
    assert np.ptp(found) > 0


def voted(rating):
    return rating / (rating + float(RULES.votes))


@pytest.fixture(scope="module")
def pairs():
    """Three scans of an office, three others near them, and their true relative poses."""
    rng = np.random.default_rng(7)
    world = office(seed=3)
    here = [free_pose(world, rng) for _ in range(PAIRS)]
    there = [_near(world, pose, rng) for pose in here]
    views = views_of([scan_at(world, pose, noise=0.01, rng=rng) for pose in here + there])
    T = np.array([between(a, b) for a, b in zip(here, there, strict=True)])
    return views, draw(views), T


@pytest.fixture(scope="module")
def slowly(pairs):
    """Drawings and end points of the same six scans."""
    views = [row(pairs[0], k) for k in range(2 * PAIRS)]
    return [(oracle.drawing(view, CONFIG), oracle.end_points(view, CONFIG)) for view in views]


def test_every_cell_is_drawn_as_one_by_one(pairs, slowly):
    _, drawn, _ = pairs
    for index, (cells, _) in enumerate(slowly):
        wanted = np.zeros((CONFIG.size, CONFIG.size), int)
        for cell, says in cells.items():
            wanted[cell] = 1 if says == "agrees" else 2
        got = np.where(drawn.cells[index] > 1, 2, drawn.cells[index])
        assert (wanted == 1).sum() > 10
        assert (wanted == 2).sum() > 10
        # The middle of a cell may lie at a threshold, or between two beams.
        assert (got != wanted).sum() <= 3


def test_end_points_are_evenly_spread_hits_and_far_away_where_there_is_none(pairs, slowly):
    _, drawn, _ = pairs
    for index, (_, points) in enumerate(slowly):
        assert drawn.hits[index] == len(points)
        near = np.hypot(drawn.x[index], drawn.y[index]) < 100
        found = np.column_stack([drawn.x[index], drawn.y[index]])[near]
        np.testing.assert_array_equal(found, points)


@pytest.mark.parametrize(
    "offset", [(0, 0, 0), (0.1, -0.05, 0.03), (0.5, 0.3, -0.2), (3, -2, 1.5)], ids=str
)
def test_a_glance_counts_as_point_by_point(pairs, slowly, offset):
    _, drawn, T = pairs
    T = np.array([compose(pose, offset) for pose in T])
    queries = row(drawn, np.arange(PAIRS, 2 * PAIRS))
    got = glances(drawn, range(PAIRS), queries, T, rating=0.7)
    wanted = [
        oracle.glance(slowly[k], slowly[PAIRS + k], T[k], 0.7, CONFIG, RULES) for k in range(PAIRS)
    ]
    # A point may lie at the border of two cells.
    off = np.abs(got - wanted)
    assert np.all(off < 0.03)
    assert np.sum(off > 1e-5) <= 1


def test_a_scan_agrees_with_itself_in_every_point():
    score = one(around(3.0), around(3.0), rating=0.5)
    np.testing.assert_allclose(score, voted(0.5) / (1 + float(RULES.doubt)) ** 2, rtol=1e-5)


def test_the_true_pose_scores_higher_than_one_that_is_a_metre_off(pairs):
    _, drawn, T = pairs
    queries = row(drawn, np.arange(PAIRS, 2 * PAIRS))
    true = glances(drawn, range(PAIRS), queries, T)
    for offset in ((1, 0, 0), (0, -1, 0), (0, 0, 0.5)):
        off = glances(drawn, range(PAIRS), queries, [compose(pose, offset) for pose in T])
        assert np.mean(off) < 0.5 * np.mean(true)


def test_points_in_free_space_contradict():
    """Half of the query's points stand where the reference saw through to its wall."""
    score = one(around(6.0), around(np.where(HALF, 2.0, 6.0)))
    doubt, contradiction = float(RULES.doubt) * 32, float(RULES.contradiction)
    # Of the reference's points, those behind what the query saw say nothing.
    wanted = 16 / (16 + contradiction * 16 + doubt) * 16 / (16 + doubt) * voted(1.0)
    np.testing.assert_allclose(score, wanted, rtol=1e-5)
    assert one(around(6.0), around(2.0)) == 0


def test_points_where_nothing_was_seen_say_nothing():
    score = one(around(np.where(HALF, np.inf, 6.0)), around(6.0))
    doubt = float(RULES.doubt)
    wanted = 16 / (16 + 32 * doubt) * 16 / (16 + 16 * doubt) * voted(1.0)
    np.testing.assert_allclose(score, wanted, rtol=1e-5)


def test_points_outside_the_drawing_say_nothing():
    """At 20 m they would contradict a wall at 30 m; the drawing ends at 12 m."""
    score = one(around(np.where(HALF, 30.0, 6.0)), around(np.where(HALF, 20.0, 6.0)))
    np.testing.assert_allclose(
        score, (16 / (16 + 32 * float(RULES.doubt))) ** 2 * voted(1.0), rtol=1e-5
    )
    assert one(around(6.0), around(6.0), (1e4, -1e4, 1.0)) == 0


def test_a_rating_of_zero_scores_zero_also_where_any_other_is_worth_all():
    scans = around(6.0), around(6.0)
    scores = [one(*scans, rating=rating, rules=GlanceConfig(votes=0.0)) for rating in (0.0, 0.1)]
    assert scores[0] == 0
    np.testing.assert_allclose(scores[1], (1 + float(RULES.doubt)) ** -2, rtol=1e-5)


def test_the_score_grows_with_the_rating_and_falls_with_contradiction():
    scans = around(6.0), around(np.where(HALF, 2.0, 6.0))
    scores = [one(*scans, rating=rating) for rating in (0.0, 0.1, 1.0, 100.0)]
    assert 0 == scores[0] < scores[1] < scores[2] < scores[3] < 1
    assert one(*scans) > one(*scans, rules=GlanceConfig(contradiction=3.0))


def test_scores_lie_between_zero_and_one_wherever_the_scans_are_put(pairs):
    _, drawn, _ = pairs
    rng = np.random.default_rng(2)
    queries = row(drawn, np.arange(PAIRS, 2 * PAIRS))
    for scale in (0.3, 3.0, 30.0, 1e5):
        for rating in (0.0, 0.5, 20.0):
            scores = glances(drawn, range(PAIRS), queries, rng.normal(0, scale, (PAIRS, 3)), rating)
            assert np.all(np.isfinite(scores) & (scores >= 0) & (scores <= 1))


def test_a_scan_without_hits_has_an_empty_drawing_and_no_score():
    blank = around(np.inf)
    drawn = draw(views_of([blank]))
    assert not drawn.cells[0].any()
    assert drawn.hits[0] == 0
    assert one(around(3.0), blank) == one(blank, around(3.0)) == one(blank, blank) == 0


@pytest.mark.parametrize(("name", "value"), [("points", 0), ("points", 127), ("size", 0)])
def test_bad_capacities_are_refused_by_name_and_value(name, value):
    with pytest.raises(ValueError, match=f"{name}: {value}"):
        RasterConfig(**{name: value})
