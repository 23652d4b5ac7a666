import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aprjax.io.archive import SCAN_FIELDS, Archive
from aprjax.scan import Scan, as_stack

NAN, INF = np.nan, np.inf
FIELDS = ("ranges", "angle_min", "angle_increment", "range_min", "range_max", "beams")
LOW, HIGH = np.float32(0.1), np.float32(10.0)


@jax.jit
def derived(scan):
    """All that a scan tells of its beams."""
    names = ("hit", "no_return", "real", "full_turn", "bearings", "points")
    return {name: getattr(scan, name) for name in names}


def make(ranges, **changes):
    fields = {"angle_min": -1.0, "angle_increment": 0.01, "range_min": 0.1, "range_max": 10.0}
    return Scan.make(ranges, **(fields | changes))


@pytest.mark.parametrize(
    ("value", "meaning"),
    [
        (5.0, "hit"),
        (LOW, "hit"),
        (HIGH, "hit"),
        (np.nextafter(LOW, np.float32(0)), "invalid"),
        (np.nextafter(HIGH, np.float32(99)), "invalid"),
        (0.0, "invalid"),
        (-0.0, "invalid"),
        (-3.0, "invalid"),
        (10.5, "invalid"),
        (3e38, "invalid"),
        (1e39, "invalid"),  # finite, though not in float32
        (-1e39, "invalid"),
        (NAN, "invalid"),
        (-INF, "invalid"),
        (INF, "no return"),
    ],
)
@pytest.mark.filterwarnings("ignore:overflow encountered in cast:RuntimeWarning")
def test_a_range_means_what_rep_117_says(value, meaning):
    beam = derived(make([value]))
    assert bool(beam["hit"][0]) == (meaning == "hit")
    assert bool(beam["no_return"][0]) == (meaning == "no return")
    assert np.isfinite(beam["points"]).all()


def test_zero_and_less_are_never_hits_even_where_the_shortest_range_is_zero():
    assert make([1e-6, 0.0, -1e-6], range_min=0.0).hit.tolist() == [True, False, False]


def test_padding_is_neither_hit_nor_free_whatever_it_holds():
    scan = make([1.0, INF]).pad(4)
    for fill in (NAN, 1.0, INF):
        ranges = np.array([1.0, INF, fill, fill], np.float32)
        other = derived(Scan(ranges, *(getattr(scan, name) for name in FIELDS[1:])))
        assert other["hit"].tolist() == [True, False, False, False]
        assert other["no_return"].tolist() == [False, True, False, False]
        assert other["real"].tolist() == [True, True, False, False]


def test_beam_i_looks_along_angle_min_and_i_increments():
    beams = derived(make(np.full(181, 2.0), angle_min=-np.pi / 2, angle_increment=np.pi / 180))
    np.testing.assert_allclose(beams["bearings"], np.radians(np.arange(-90, 91)), atol=1e-6)
    np.testing.assert_allclose(beams["points"][90], [2.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(beams["points"][180], [0.0, 2.0], atol=1e-6)


def test_an_upside_down_scanner_sweeps_clockwise():
    scan = make([1.0, 1.0], angle_min=0.0, angle_increment=-np.pi / 2)
    np.testing.assert_allclose(derived(scan)["points"][1], [0.0, -1.0], atol=1e-6)


def test_points_of_beams_that_hit_nothing_lie_at_the_origin():
    points = np.asarray(derived(make([NAN, INF, -INF, 0.0, 11.0, 2.0]))["points"])
    assert not points[:5].any()
    assert points[5].any()


@pytest.mark.parametrize(
    ("beams", "degrees", "full"),
    [
        (360, 1.0, True),
        (361, 1.0, True),  # both ends of the turn reported
        (720, 0.5, True),
        (360, -1.0, True),
        (359, 1.0, False),
        (181, 1.0, False),
        (4, 90.0, True),
        (3, 90.0, False),
        (1, 1.0, False),
    ],
)
def test_a_full_turn_is_known_from_beams_and_increment(beams, degrees, full):
    assert bool(make(np.ones(beams), angle_increment=np.radians(degrees)).full_turn) == full


def test_a_full_turn_does_not_depend_on_padding():
    scan = make(np.ones(360), angle_increment=np.radians(1))
    assert bool(scan.pad(500).full_turn)


@pytest.mark.parametrize(
    ("changes", "field", "value"),
    [
        ({"ranges": []}, "ranges", "(0,)"),
        ({"ranges": 3.0}, "ranges", "()"),
        ({"ranges": np.ones((2, 3))}, "ranges", "(2, 3)"),
        ({"angle_min": NAN}, "angle_min", "nan"),
        ({"angle_min": INF}, "angle_min", "inf"),
        ({"angle_min": -INF}, "angle_min", "-inf"),
        ({"angle_increment": NAN}, "angle_increment", "nan"),
        ({"angle_increment": INF}, "angle_increment", "inf"),
        ({"angle_increment": 0.0}, "angle_increment", "0.0"),
        ({"angle_increment": 1.0, "ranges": np.ones(8)}, "angle_increment", "1.0"),
        ({"angle_increment": -1.0, "ranges": np.ones(8)}, "angle_increment", "-1.0"),
        ({"range_min": NAN}, "range_min", "nan"),
        ({"range_min": -0.5}, "range_min", "-0.5"),
        ({"range_min": 10.0}, "range_min", "10.0"),
        ({"range_min": 12.5}, "range_min", "12.5"),
        ({"range_max": NAN}, "range_max", "nan"),
        ({"range_max": INF}, "range_max", "inf"),
        ({"range_max": 0.05}, "range_max", "0.05"),
        ({"range_max": 1e39}, "range_max", "1e+39"),  # infinite in float32
    ],
)
@pytest.mark.filterwarnings("ignore:overflow encountered in cast:RuntimeWarning")
def test_a_bad_argument_is_refused_by_name_and_value(changes, field, value):
    changes = dict(changes)
    with pytest.raises(ValueError) as error:
        make(changes.pop("ranges", [1.0, 2.0]), **changes)
    assert field in str(error.value)
    assert value in str(error.value)


NUMBERS = st.floats() | st.sampled_from([0.0, 1e-46, 1e-50, 0.01, np.pi, 30.0 - 1e-9, 30.0])


@given(
    ranges=st.lists(st.floats(), min_size=1, max_size=5),
    turn=NUMBERS,
    fields=st.fixed_dictionaries(
        {"angle_min": NUMBERS, "range_min": NUMBERS, "range_max": NUMBERS}
    ),
)
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
def test_a_scan_that_is_made_is_one_that_a_file_may_hold(ranges, turn, fields):
    try:
        scan = Scan.make(ranges, angle_increment=turn, **fields)
    except ValueError as error:
        assert str(error).partition(":")[0] in FIELDS
        return
    arrays = {
        name: np.asarray(getattr(scan, name), kind)[None] for name, kind in SCAN_FIELDS.items()
    }
    Archive(arrays | {"ranges": scan.ranges[None]}, "reference file").scans(1)


def test_what_is_stored_is_what_was_given_to_the_bit():
    scan = make([1.0, 2.0], angle_min=-0.1, angle_increment=1 / 3, range_min=1e-3, range_max=1e9)
    assert scan.angle_min == np.float32(-0.1)
    assert scan.angle_increment == np.float32(1 / 3)
    assert scan.range_min == np.float32(1e-3)
    assert scan.range_max == np.float32(1e9)
    for name in FIELDS[1:5]:
        assert getattr(scan, name).dtype == np.float32


def test_of_a_full_turn_with_both_ends_the_last_beam_is_left_out():
    for beams, degrees in ((361, 1.0), (361, -1.0), (1441, 0.25)):
        assert make(np.ones(beams), angle_increment=np.radians(degrees)).beams == beams - 1


@pytest.mark.parametrize(
    ("beams", "degrees", "kept"),
    [
        (4, 103, 4),  # the ends of the turn half an increment apart
        (361, 0.9985, 361),
        (361, 0.9998, 360),  # an increment that a driver has rounded
        (361, 1.0009, 360),
        (720, 360 / 719, 719),  # as drivers of RPLIDAR state it
    ],
)
def test_a_last_beam_is_left_out_only_where_the_first_one_looks(beams, degrees, kept):
    assert make(np.ones(beams), angle_increment=np.radians(degrees)).beams == kept


def test_ranges_may_be_lists_and_integers():
    scan = make([1, 2, 3])
    assert np.asarray(scan.ranges).dtype == np.float32
    assert np.asarray(scan.hit).all()


def test_making_a_scan_puts_nothing_on_a_device():
    scan = make([1.0, 2.0])
    assert not any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(scan))


def test_padding_changes_no_beam():
    scan = make([1.0, NAN, INF, 4.0])
    padded = scan.pad(7)
    assert padded.ranges.shape == (7,)
    assert padded.beams == 4
    before, after = derived(scan), derived(padded)
    for name in ("hit", "no_return", "bearings", "points"):
        np.testing.assert_array_equal(after[name][:4], before[name])
    assert np.isfinite(after["points"]).all()


def test_padding_to_fewer_slots_is_refused():
    with pytest.raises(ValueError, match=r"slots: 3 .* 4"):
        make([1.0] * 4).pad(3)


def test_a_stack_holds_scans_of_any_beam_counts():
    rng = np.random.default_rng(0)
    scans = [
        make(rng.uniform(0, 12, beams), angle_increment=1e-3 * (i + 1), angle_min=0.1 * i)
        for i, beams in enumerate([1, 2, 181, 361, 100])
    ]
    batch = Scan.stack(scans)
    assert batch.ranges.shape[0] == 5
    assert batch.ranges.shape[1] >= 361
    together = derived(batch)
    for i, scan in enumerate(scans):
        beams, alone = int(scan.beams), derived(scan)
        assert batch.beams[i] == beams
        np.testing.assert_array_equal(together["hit"][i, :beams], alone["hit"])
        assert not together["hit"][i, beams:].any()
        np.testing.assert_allclose(together["points"][i, :beams], alone["points"], atol=1e-6)


def test_a_stack_takes_the_slots_it_is_told():
    assert Scan.stack([make([1.0]), make([1.0, 2.0])], slots=5).ranges.shape == (2, 5)
    with pytest.raises(ValueError, match="slots: 1 "):
        Scan.stack([make([1.0]), make([1.0, 2.0])], slots=1)


def test_an_empty_stack_is_refused():
    with pytest.raises(ValueError, match="scans"):
        Scan.stack([])


def test_a_batch_within_a_stack_is_refused_by_its_index():
    with pytest.raises(ValueError, match=r"scans\[1\].*\(2, 64\)"):
        Scan.stack([make([1.0]), Scan.stack([make([1.0]), make([2.0])])])


@pytest.mark.parametrize(
    ("scans", "message"),
    [
        (None, "scans: NoneType is no list of scans"),
        ([None], r"scans\[0\]: NoneType is no Scan"),
        (["a", "b"], r"scans\[0\]: str is no Scan"),
        (make([1.0]), r"scans: ranges of shape \(1,\) are not \(references, beams\)"),
        (
            eqx.tree_at(lambda s: s.ranges, Scan.stack([make([1.0])]), np.empty((1, 0))),
            r"scans: ranges of shape \(1, 0\) are not \(references, beams\)",
        ),
    ],
)
def test_what_is_no_list_of_scans_is_refused_by_its_index(scans, message):
    with pytest.raises(ValueError, match=message):
        as_stack(scans)


def test_an_iterator_of_scans_is_stacked_as_their_list_is():
    scans = [make([1.0]), make([2.0, 3.0])]
    for ours, wanted in zip(
        *map(jax.tree.leaves, (as_stack(iter(scans)), Scan.stack(scans))), strict=True
    ):
        np.testing.assert_array_equal(ours, wanted)


def test_a_stack_of_the_documented_dtypes_is_taken_as_it_is():
    stack = Scan.stack([make([1.0]), make([2.0, 3.0])])
    assert as_stack(stack) is stack
    on_device = jax.device_put(stack)
    assert as_stack(on_device) is on_device


def test_numbers_of_a_stack_that_fit_no_documented_dtype_are_refused_or_say_nothing():
    fields = {name: getattr(Scan.stack([make([1.0]), make([2.0])]), name) for name in FIELDS}
    with pytest.raises(ValueError, match=r"beams\[1\]: 1\.5 is no number of beams"):
        as_stack(Scan(**fields | {"beams": np.array([1.0, 1.5])}))
    with pytest.raises(ValueError, match=r"beams\[0\]: nan is no number of beams"):
        as_stack(Scan(**fields | {"beams": np.array([NAN, 1.0])}))
    with pytest.raises(ValueError, match="ranges: "):
        as_stack(Scan(**fields | {"ranges": np.array([["a"], ["b"]])}))
    for count in (-1, 65):
        beams = np.array([1, count], np.int32)
        with pytest.raises(ValueError, match=rf"^beams\[1\]: {count} is not from 0 to 64$"):
            as_stack(Scan(**fields | {"beams": beams}))
        one = jax.tree.map(lambda array: array[1], Scan(**fields | {"beams": beams}))
        with pytest.raises(ValueError, match=rf"^scans\[1\]: {count} beams is not from 0 to 64$"):
            as_stack([make([1.0]), one])
    hidden = np.ma.masked_array(np.array([[1.0], [2.0]], np.float32), mask=[[True], [False]])
    np.testing.assert_array_equal(
        as_stack(Scan(**fields | {"ranges": hidden})).ranges, [[NAN], [2]]
    )
    large = as_stack(Scan(**fields | {"ranges": np.array([[1e39], [INF]])})).ranges
    assert np.isnan(large[0, 0])
    assert large[1, 0] == INF


def test_a_padded_batch_has_scans_without_beams_at_its_end():
    batch = Scan.stack([make([1.0, 2.0]), make([3.0, INF])])
    padded = batch.pad_batch(4)
    assert np.asarray(padded.beams).tolist() == [2, 2, 0, 0]
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(padded, name)[:2], getattr(batch, name))
    beams = derived(padded)
    for name in ("hit", "no_return", "real", "full_turn", "points"):
        assert not beams[name][2:].any()
    assert np.isfinite(beams["bearings"]).all()
    np.testing.assert_array_equal(batch.pad_batch(2).ranges, batch.ranges)


def test_padding_a_batch_to_fewer_scans_is_refused():
    batch = Scan.stack([make([1.0]), make([2.0])])
    with pytest.raises(ValueError, match="size: 1 "):
        batch.pad_batch(1)


def test_a_batch_means_what_its_scans_mean_under_vmap():
    batch = Scan.stack([make([1.0, INF, 20.0]), make([NAN, 2.0]), make([3.0])])
    each, whole = jax.vmap(derived)(batch), derived(batch)
    for name, values in each.items():
        np.testing.assert_allclose(values, whole[name], atol=1e-7)


@pytest.mark.usefixtures("nans")
def test_points_have_finite_gradients_where_ranges_are_bad():
    scan = jax.tree.map(jnp.asarray, make([1.0, NAN, INF, -INF, 0.0, 20.0]))

    def total(ranges):
        fields = [getattr(scan, name) for name in FIELDS[1:]]
        return jnp.sum(Scan(ranges, *fields).points)

    slope = np.asarray(jax.jit(jax.grad(total))(scan.ranges))
    assert np.isfinite(slope).all()
    assert slope[0] != 0
    assert not slope[1:].any()
