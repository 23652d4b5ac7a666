"""Scans, logs and configurations of all kinds: no crash, documented errors, no NaN in a result.

`APRJAX_EXAMPLES` is how many of each are tried, by default few, and always the same.
"""

import json
import os

import jax
import numpy as np
import pytest

pytest.importorskip("hypothesis", reason="properties ask for the extra aprjax[test]")

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aprjax.batch import match_batch
from aprjax.configuration import from_dict, to_dict
from aprjax.features import FeatureConfig
from aprjax.matcher import MatchConfig
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.status import Status
from tests.fuzz.targets import TARGETS
from tests.test_matcher import assert_consistent, to_numpy
from tests.worlds import free_pose, office, scan_at

EXAMPLES = int(os.environ.get("APRJAX_EXAMPLES", "0"))
QUERIES, REFERENCES, BEAMS = 20, 8, 181  # as other tests have, to share their compilations


def tried(few: int):
    """How many examples a property is tried on."""
    return settings(
        max_examples=EXAMPLES or few,
        derandomize=not EXAMPLES,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


STRANGE = st.sampled_from(
    [np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1e-38, 1e-45, 1e38, 1e39, 5000.0, 81.83]
)
NUMBERS = STRANGE | st.floats() | st.floats(0, 40)


@st.composite
def any_scans(draw) -> Scan:
    """A scan of an office of any size, some of whose beams are strange; or of noise alone."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    beams = draw(st.sampled_from([1, 2, 3, 60, BEAMS]))
    world = office(seed=3)
    scan = scan_at(world, free_pose(world, rng), beams=max(beams, 2), noise=0.01, rng=rng)
    ranges = np.array(scan.ranges[:beams], float)
    if draw(st.booleans()):
        ranges = rng.choice([0.5, 1.0, 9.0, 30.0], beams) * rng.uniform(0.9, 1.1, beams)
    with np.errstate(over="ignore"):
        ranges *= 10.0 ** draw(st.sampled_from([0, 0, 0, -3, 3, 20, -20]))
    values = draw(st.lists(NUMBERS, max_size=8))
    ranges[rng.integers(beams, size=len(values))] = values
    turn = draw(st.sampled_from([1.0, -1.0, 0.1, 1e-6, 1e-30]))
    return Scan.make(
        ranges,
        angle_min=draw(st.sampled_from([0.0, -np.pi / 2, 1e6, -1e30])),
        angle_increment=turn * float(scan.angle_increment),
        range_min=draw(st.sampled_from([0.0, 0.02, 1e-30])),
        range_max=draw(st.sampled_from([30.0, 0.5, 1e30])),
    )


@given(
    ranges=st.lists(NUMBERS | st.integers(), max_size=5) | st.lists(st.lists(NUMBERS, max_size=2)),
    fields=st.fixed_dictionaries(
        dict.fromkeys(("angle_min", "angle_increment", "range_max"), NUMBERS),
        optional={"range_min": NUMBERS},
    ),
)
@tried(200)
def test_a_scan_is_made_or_refused_by_the_name_of_a_field(ranges, fields):
    try:
        scan = Scan.make(ranges, **fields)
    except ValueError as error:
        assert str(error).partition(": ")[0] in {"ranges", "range_min", *fields}
        return
    assert 0 <= scan.range_min < scan.range_max < np.inf
    assert 0 < scan.beams == len(scan.ranges) <= len(ranges)
    assert not np.any(np.asarray(scan.hit) & np.asarray(scan.no_return))


@pytest.fixture(scope="module")
def references():
    rng, world = np.random.default_rng(0), office(seed=3)
    return ReferenceSet.build([scan_at(world, free_pose(world, rng)) for _ in range(REFERENCES)])


def check(result, references):
    assert_consistent(result, references)
    assert np.all(np.isin(result.status, [int(status) for status in Status]))
    assert np.all((result.probability >= 0) & (result.probability <= 1))
    assert not np.any(result.valid[result.status > Status.CAPACITY_EXCEEDED])


@given(scans=st.lists(any_scans(), min_size=QUERIES, max_size=QUERIES))
@tried(4)
def test_any_scans_are_described_and_matched_without_a_nan(references, scans):
    queries = Scan.stack(scans, slots=192)
    check(to_numpy(match_batch(queries, references)), references)
    strange = ReferenceSet.build(Scan.stack(scans[:REFERENCES], slots=192))
    for leaf in jax.tree.leaves(strange.index):
        assert not np.any(np.isnan(np.asarray(leaf, float)))
    check(to_numpy(match_batch(queries, strange)), strange)


@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([1.5, 10.0, 1000.0]))
@tried(4)
def test_no_thresholds_lead_to_a_nan(references, seed, spread):
    rng, world = np.random.default_rng(seed), office(seed=3)
    config = jax.tree.map(
        lambda leaf: np.float32(leaf * np.exp(rng.uniform(-1, 1) * np.log(spread))), MatchConfig()
    )
    scans = [scan_at(world, free_pose(world, rng), noise=0.01, rng=rng) for _ in range(QUERIES)]
    found = to_numpy(match_batch(scans, references, config))
    for leaf in jax.tree.leaves(found):
        assert np.all(np.isfinite(leaf))


PLAIN = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3)


def leaves(values, path=()):
    for name, value in values.items():
        yield from leaves(value, (*path, name)) if isinstance(value, dict) else [(*path, name)]


@given(kind=st.sampled_from([FeatureConfig, MatchConfig]), data=st.data())
@tried(100)
def test_a_configuration_is_read_or_refused_and_what_was_read_comes_back(kind, data):
    values = to_dict(kind())
    *group, name = data.draw(st.sampled_from(list(leaves(values))))
    inner = values
    for each in group:
        inner = inner[each]
    inner[name] = data.draw(PLAIN | st.dictionaries(st.text(max_size=3), PLAIN, max_size=2))
    try:
        config = from_dict(kind, values)
    except ValueError as error:
        assert "\n" not in str(error)
        return
    again = to_dict(from_dict(kind, json.loads(json.dumps(to_dict(config)))))
    assert json.dumps(again) == json.dumps(to_dict(config))


WORDS = st.sampled_from(["0", "1", "-1", "180", "1e308", "nan", "inf", "1_0", "", "x", "é"])
NUMBER_WORDS = st.floats(-100, 100).map(repr) | WORDS


@st.composite
def lines(draw) -> str:
    """A line of a log whose numbers and counts are mostly as they should be."""
    count = draw(st.integers(0, 6))
    said = draw(st.sampled_from([count, count, count, count + 1, -1]))

    def numbers(n):
        return " ".join(draw(st.lists(NUMBER_WORDS, min_size=n, max_size=n)))

    kind = draw(st.sampled_from(["FLASER", "RAWLASER1", "ROBOTLASER1", "ODOM", "PARAM", "#"]))
    if kind == "FLASER":
        return f"{kind} {said} {numbers(count)} {numbers(6)} 1.5 host 1.5"
    if kind == "ODOM":
        return f"{kind} {numbers(3)} 0 0 0 1.5 host 1.5"
    if kind == "PARAM":
        return f"{kind} laser_front_laser_resolution {numbers(1)} 0 host 0"
    tail = "0 1.5 host 1.5" if kind == "RAWLASER1" else f"0 {numbers(6)} 0 0 0 0 0 1.5 host 1.5"
    first = draw(st.sampled_from(["0 -1.5 3 0.5 80", "0 -1.5 3 -0.5 5"])) if count else numbers(5)
    return f"{kind} {first} 0.01 0 {said} {numbers(count)} {tail}"


@given(text=st.lists(lines(), max_size=8).map("\n".join))
@tried(150)
def test_a_log_is_read_without_a_nan_or_refused_in_one_line(tmp_path_factory, text):
    TARGETS["carmen"].check(text.encode(), tmp_path_factory.getbasetemp())
