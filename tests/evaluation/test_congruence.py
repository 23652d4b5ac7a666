import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.evaluation.congruence import (
    CongruenceConfig,
    QualityConfig,
    Verdicts,
    both_ways,
    congruence,
    quality,
    sees,
)
from aprjax.evaluation.screen import ScreenConfig, SketchConfig, screen, sketch
from aprjax.references import ReferenceSet
from aprjax.se2 import inverse
from tests.make_logs import _near
from tests.oracles import evaluation as oracle
from tests.worlds import cast, free_pose, office, scan_at

PAIRS = 8
ANCHORS = 6
EVERY_BEAM = CongruenceConfig(beams=192)


@jax.jit
@jax.vmap
def _compare(reference, query, T_ref_query):
    config = EVERY_BEAM
    ahead, back = both_ways(reference, query, T_ref_query, config)
    seen = sees(reference, T_ref_query[:2]), sees(query, inverse(T_ref_query)[:2])
    anchors = jnp.int32(ANCHORS)
    e_m = quality(ahead, back, *seen, anchors, config.quality)
    ours, theirs = sketch(query, SketchConfig()), sketch(reference, SketchConfig())
    stacked = jax.tree.map(lambda array: array[None], theirs)
    rough = screen(stacked, jnp.int32(0), ours, T_ref_query, anchors, ScreenConfig())
    return ahead, back, seen, e_m, rough


def compare(reference, query, T_ref_query):
    """Both verdicts, both overviews, e_m and the screen's rough e_m, for six agreeing anchors."""
    return jax.tree.map(np.asarray, _compare(reference, query, T_ref_query))


def view_of(scans):
    return jax.tree.map(np.asarray, ReferenceSet.build(scans).index.features.view)


def row(tree, index):
    return jax.tree.map(lambda array: array[index], tree)


def one(reference, query, T_ref_query):
    """`compare` for one pair of scans."""
    views = view_of([reference, query])
    first, second = (row(views, np.full(PAIRS, index)) for index in (0, 1))
    return row(compare(first, second, np.tile(T_ref_query, (PAIRS, 1)).astype(np.float32)), 0)


def moved(T, offset):
    return np.array([oracle.compose(pose, offset) for pose in T], np.float32)


@pytest.fixture(scope="module")
def pairs():
    """Eight scans of an office, eight others near them, and their true relative poses."""
    rng = np.random.default_rng(7)
    world = office(seed=3)
    here = [free_pose(world, rng) for _ in range(PAIRS)]
    there = [_near(world, pose, rng) for pose in here]
    scans = [scan_at(world, pose, noise=0.01, rng=rng) for pose in here + there]
    views = view_of(scans)
    T = np.array([oracle.between(a, b) for a, b in zip(here, there, strict=True)], np.float32)
    return row(views, slice(0, PAIRS)), row(views, slice(PAIRS, 2 * PAIRS)), T


@pytest.mark.parametrize(
    "offset", [(0, 0, 0), (0.07, -0.05, 0.02), (0.4, 0.2, 0.1), (-0.3, 0.6, -0.3)], ids=str
)
def test_verdicts_are_counted_as_beam_by_beam(pairs, offset):
    first, second, T = pairs
    T = moved(T, offset)
    ahead, back, *_ = compare(first, second, T)
    for index in range(0, PAIRS, 3):
        a, b = row(first, index), row(second, index)
        for got, expected in (
            (
                row(ahead, index),
                oracle.verdicts(a, b, oracle.inverse(T[index]), EVERY_BEAM),
            ),
            (row(back, index), oracle.verdicts(b, a, T[index], EVERY_BEAM)),
        ):
            # A ray may pass a surface's very end on either side.
            np.testing.assert_allclose((got.agree, got.contradict), expected[:2], atol=2)
            assert got.hits == expected[2]


def test_both_ways_are_either_way_alone_whatever_the_padding(pairs):
    first, second, T = (row(tree, slice(2)) for tree in pairs)
    wider = jax.vmap(lambda view: view.pad(first.range.shape[-1] + 40))(first)

    def each(reference, query, T_ref_query):
        ahead = congruence(reference, query, inverse(T_ref_query), EVERY_BEAM)
        return ahead, congruence(query, reference, T_ref_query, EVERY_BEAM)

    alone = jax.vmap(each)(first, second, T)
    for reference in (first, wider):
        together = jax.vmap(both_ways, (0, 0, 0, None))(reference, second, T, EVERY_BEAM)
        for got, expected in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-5)


def test_a_view_is_not_padded_to_fewer_entries(pairs):
    with pytest.raises(ValueError, match="slots: 3 is fewer than the 192 there are"):
        row(pairs[0], 0).pad(3)


def test_e_m_is_high_at_the_true_pose(pairs):
    ahead, back, _, e_m, rough = compare(*pairs)
    extent = 0.5 * (ahead.extent + back.extent)
    best = ANCHORS / (ANCHORS + float(QualityConfig().anchors))
    best = best * extent / (extent + float(QualityConfig().extent))
    assert np.all(e_m > 0.7 * best)
    assert np.all(rough > 0.5 * best)


@pytest.mark.parametrize(
    "offset",
    [
        *[(0.5 * np.cos(a), 0.5 * np.sin(a), 0.0) for a in np.radians([0, 45, 90, 180, 225, 270])],
        *[(0.0, 0.0, np.radians(a)) for a in (-10, 10)],
    ],
    ids=lambda o: f"{o[0]:.1f},{o[1]:.1f},{o[2]:.2f}",
)
def test_e_m_is_clearly_lower_half_a_metre_or_ten_degrees_off(pairs, offset):
    first, second, T = pairs
    *_, true, _ = compare(first, second, T)
    *_, e_m, rough = compare(first, second, moved(T, offset))
    assert np.all(e_m < 0.5 * true)
    assert np.median(e_m) < 0.25 * np.median(true)
    assert np.all((rough >= 0) & (rough <= 1))


@pytest.mark.parametrize("offset", [(0, 0, 0), (0.1, 0.1, 0.05), (0.5, -0.3, 0.2)], ids=str)
def test_e_m_is_the_same_from_either_side(pairs, offset):
    first, second, T = pairs
    T = moved(T, offset)
    T_back = np.array([oracle.inverse(pose) for pose in T], np.float32)
    ahead, back, seen, e_m, rough = compare(first, second, T)
    ahead_, back_, seen_, e_m_, rough_ = compare(second, first, T_back)
    np.testing.assert_allclose(e_m, e_m_, atol=0.02)
    np.testing.assert_allclose(rough, rough_, atol=0.04)
    np.testing.assert_allclose(ahead.agree, back_.agree, atol=2)
    np.testing.assert_allclose(back.contradict, ahead_.contradict, atol=2)
    assert np.mean(np.asarray(seen) == np.asarray(seen_)[::-1]) > 0.9


def test_e_m_lies_between_zero_and_one_wherever_the_scans_are_put(pairs):
    first, second, _ = pairs
    rng = np.random.default_rng(2)
    for scale in (0.3, 3.0, 30.0):
        T = (rng.normal(0, scale, (PAIRS, 3))).astype(np.float32)
        ahead, back, _, e_m, rough = compare(first, second, T)
        for value in (e_m, rough):
            assert np.all(np.isfinite(value) & (value >= 0) & (value <= 1))
        for verdicts in (ahead, back):
            assert np.all(verdicts.agree + verdicts.contradict <= verdicts.hits)


@pytest.mark.parametrize("apart", [0.1, 0.2])
def test_scans_that_overlap_little_never_agree_much(apart):
    """Face to face in a long hall: only the strip between them lies in both fields of view.

    Nothing contradicts, and all that overlaps agrees, less than a tenth of the beams.
    """
    sides = [[[-15, -4], [15, -4]], [[-15, 4], [15, 4]]]
    ends = [[[-15, -4], [-15, 4]], [[15, -4], [15, 4]]]
    hall = np.array(sides + ends, float)
    here, there = np.array([-apart, 0.3, 0.0]), np.array([apart, -0.3, np.pi])
    ahead, back, _, e_m, _ = one(
        scan_at(hall, here), scan_at(hall, there), oracle.between(here, there)
    )
    assert ahead.contradict == back.contradict == 0
    assert 0 < ahead.agree < 0.1 * ahead.hits
    assert e_m < 0.4 * ANCHORS / (ANCHORS + float(QualityConfig().anchors))


def verdicts(agree, contradict, extent=4.0):
    """Verdicts of 180 beams."""
    numbers = {"agree": agree, "contradict": contradict, "hits": 180, "extent": extent}
    return Verdicts(**{name: jnp.float32(number) for name, number in numbers.items()})


def test_the_extent_is_the_spread_of_the_end_points_that_agree():
    xy = np.random.default_rng(0).normal(0, 2, (20, 2)).astype(np.float32)
    agree = np.arange(20) % 3 == 0
    found = Verdicts.count(agree, ~agree, np.ones(20, bool), *xy.T)
    spread = np.sqrt(np.mean(np.sum((xy[agree] - xy[agree].mean(axis=0)) ** 2, axis=1)))
    np.testing.assert_allclose(found.extent, spread, rtol=1e-5)
    assert (found.agree, found.contradict, found.hits) == (7, 13, 20)
    nothing = Verdicts.count(np.zeros(20, bool), agree, np.ones(20, bool), *xy.T)
    assert nothing.extent == nothing.agree == 0


def test_e_m_grows_with_the_extent_of_what_agrees():
    def e_m(extent):
        said, yes = verdicts(120, 10, extent), jnp.asarray(True)
        return float(quality(said, said, yes, yes, jnp.int32(6), QualityConfig()))

    assert 0 == e_m(0.0) < e_m(0.5) < e_m(2.0) < e_m(8.0) < 1


@pytest.mark.parametrize(("anchors", "extent"), [(0, 4.0), (6, 0.0), (0, 0.0)])
def test_nothing_that_agrees_is_worth_zero_also_where_one_half_is_worth_nothing(anchors, extent):
    said, yes = verdicts(120, 10, extent), jnp.asarray(True)
    config = QualityConfig(anchors=0.0, extent=0.0)
    assert quality(said, said, yes, yes, jnp.int32(anchors), config) == 0
    some = verdicts(120, 10, extent=1e-3)
    assert quality(some, some, yes, yes, jnp.int32(1), config) > 0.5


@pytest.mark.parametrize("agree", [0, 1, 5, 9])
def test_a_twentieth_of_the_beams_is_no_match_however_many_anchors_agree(agree):
    little = verdicts(agree, 0)
    yes = jnp.asarray(True)
    assert quality(little, little, yes, yes, jnp.int32(16), QualityConfig()) < 0.3


def test_e_m_grows_with_agreement_and_anchors_and_falls_with_contradiction():
    def e_m(agree, contradict, anchors):
        said = verdicts(agree, contradict)
        yes = jnp.asarray(True)
        return float(quality(said, said, yes, yes, jnp.int32(anchors), QualityConfig()))

    assert e_m(20, 5, 5) < e_m(60, 5, 5) < e_m(120, 5, 5) < e_m(175, 5, 5)
    assert e_m(100, 0, 5) > e_m(100, 10, 5) > e_m(100, 80, 5)
    assert 0 == e_m(100, 0, 0) < e_m(100, 0, 2) < e_m(100, 0, 5) < e_m(100, 0, 16) < 1
    assert e_m(0, 0, 5) == e_m(0, 180, 5) == 0


@pytest.mark.parametrize(
    ("reference_sees", "query_sees", "expected"),
    [(True, False, (0, 0)), (False, True, (1, 1)), (True, True, (0, 1)), (False, False, (0, 1))],
    ids=["reference overlooks", "query overlooks", "both", "neither"],
)
def test_the_scan_that_sees_the_other_ones_place_is_the_overview(
    reference_sees, query_sees, expected
):
    """`ahead` counts where the reference has the overview, `back` where the query has it."""
    config = QualityConfig()
    ways = [verdicts(150, 10, extent=3.0), verdicts(60, 50, extent=5.0)]
    doubt, contradiction = float(config.doubt), float(config.contradiction)
    share = [
        (1 + doubt) * a / (a + contradiction * c + doubt * 180) for a, c in ((150, 10), (60, 50))
    ]
    got = quality(
        *ways, jnp.asarray(reference_sees), jnp.asarray(query_sees), jnp.int32(ANCHORS), config
    )
    much = ANCHORS / (ANCHORS + float(config.anchors)) * 4 / (4 + float(config.extent))
    np.testing.assert_allclose(got, share[expected[0]] * share[expected[1]] * much, rtol=1e-5)


def test_a_place_is_seen_when_nothing_stands_before_it():
    """A wall 3 m ahead with a door; places before it, behind it, through the door, and aside."""
    wall = np.array([[[3, -9], [3, 1.0]], [[3, 2.0], [3, 9]]], float)
    scan = scan_at(wall, np.zeros(3))
    places = {(2.5, 0.0): True, (3.5, 0.0): False, (4.0, 2.0): True, (-1.0, 0.0): False}
    for place, expected in places.items():
        _, _, (reference_sees, _), *_ = one(scan, scan, [*place, 0.0])
        assert bool(reference_sees) == expected, place


WALL = np.array([[[4, -6], [4, 6]]], float)
BOX = np.array([[[2, 0.5], [2, 1.5]], [[2, 0.5], [3, 0.5]], [[2, 1.5], [3, 1.5]]], float)
HERE = np.zeros(3)


def test_beams_on_the_same_wall_agree():
    there = np.array([0.5, -0.4, 0.2])
    ahead, back, *_ = one(scan_at(WALL, HERE), scan_at(WALL, there), there)
    assert ahead.contradict == back.contradict == 0
    assert ahead.agree > 0.9 * ahead.hits


def test_a_beam_through_a_claimed_surface_contradicts():
    """The overview saw a box that is gone: the beams now pass through its front."""
    with_box = scan_at(np.concatenate([WALL, BOX]), HERE)
    ahead, *_ = one(with_box, scan_at(WALL, HERE), HERE)
    on_box = np.sum(np.isfinite(cast(BOX, HERE, np.asarray(with_box.bearings))))
    assert abs(ahead.contradict - on_box) <= 2
    assert abs(ahead.agree - (ahead.hits - on_box)) <= 2


def test_a_beam_that_stops_where_the_overview_saw_free_space_contradicts():
    """A box that the overview did not see stands in what it saw through to the wall."""
    with_box = scan_at(np.concatenate([WALL, BOX]), HERE)
    ahead, *_ = one(scan_at(WALL, HERE), with_box, HERE)
    on_box = np.sum(np.isfinite(cast(BOX, HERE, np.asarray(with_box.bearings))))
    assert abs(ahead.contradict - on_box) <= 2


def test_a_beam_on_what_was_hidden_from_the_overview_says_nothing():
    """A panel behind the screen, which only the front scan sees, stops beams short of the wall."""
    room = np.concatenate([WALL, BOX[:1]])
    panel = np.array([[[2.6, 0.8], [3.2, 1.5]]])
    there = np.array([2.0, 3.0, -0.9])
    overview = scan_at(np.concatenate([room, panel]), HERE)
    without, *_ = one(overview, scan_at(room, there), there)
    with_, *_ = one(overview, scan_at(np.concatenate([room, panel]), there), there)
    assert with_.contradict == without.contradict == 0
    assert with_.hits == without.hits
    assert with_.agree < without.agree - 10


def test_scans_without_hits_have_no_verdicts_and_no_quality():
    empty = scan_at(WALL - 100.0, HERE)
    assert not np.any(np.isfinite(empty.ranges))
    for reference, query in ((empty, scan_at(WALL, HERE)), (scan_at(WALL, HERE), empty)):
        ahead, back, _, e_m, rough = one(reference, query, HERE)
        assert ahead.agree == back.agree == e_m == rough == 0
