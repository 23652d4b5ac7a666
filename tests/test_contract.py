"""Every row of the table in `aprjax.contract`, read from there."""

import re
from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np
import pytest

import aprjax.contract
from aprjax.alignment.voting import VotingConfig
from aprjax.anchors.extract import ExtractionConfig
from aprjax.batch import match, match_batch
from aprjax.configuration import from_dict
from aprjax.features import FeatureConfig
from aprjax.io.log import LogError
from aprjax.io.logs import read_log
from aprjax.matcher import MatchConfig
from aprjax.references import ReferenceSet
from aprjax.refine import RefineConfig
from aprjax.scan import Scan, as_stack
from aprjax.sharding.match import match_sharded
from aprjax.status import Status
from aprjax.sweeping.run import sweep
from tests.test_matcher import closed_room
from tests.worlds import office, scan_at

STEP = np.pi / 180


def rows() -> dict[str, str]:
    """The outcome that the table states for each input."""
    lines = re.findall(r"^\| (.*?) \| (.*?) \|$", aprjax.contract.__doc__ or "", re.MULTILINE)
    titled = [line for line in lines if line[1] and not line[0].startswith("---")]
    assert len(dict(titled)) == len(titled), "an input is there twice"
    return dict(titled[1:])


def make(ranges, **changes) -> Scan:
    return Scan.make(
        ranges, **{"angle_min": 0.0, "angle_increment": STEP, "range_max": 30.0} | changes
    )


def beam(value, **changes) -> str:
    """What the beam of one range becomes."""
    ranges = value if isinstance(value, np.ndarray) else [value]
    return kind(make(ranges, **{"range_min": 0.1} | changes))


def kind(scan: Scan) -> str:
    """What the first beam of a scan is."""
    (hit, *_), (free, *_) = np.asarray(scan.hit), np.asarray(scan.no_return)
    return "hit" if hit else "no return" if free else "invalid"


def refused(call: Callable[[], object]) -> str:
    """The error of a call, and the field that its message begins with."""
    with pytest.raises(ValueError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    return f"{type(caught.value).__name__}: {message.partition(': ')[0]}"


@pytest.fixture
def log(tmp_path):
    """The last scan of a CARMEN log of scans of these readings and one maximum."""

    def read(*scans, maximum=100.0, **options):
        lines = [
            f"RAWLASER1 0 -1.5 3.0 0.03 {maximum} 0.01 0 {count} {' '.join(map(str, readings))} 0 "
            "1.5 host 1.5\n"
            for count, readings in scans
        ]
        path = tmp_path / "run.log"
        path.write_text("".join(lines))
        return read_log(path, **options)

    return read


@pytest.fixture
def readings(log):
    """What a reading becomes in a log of ordinary ones."""

    def of(value, maximum=100.0, often=1) -> str:
        ordinary = (20, np.linspace(1, 4, 20))
        *_, entry = log(*[ordinary] * 3, (often, [value] * often), maximum=maximum)
        return kind(entry.scan)

    return of


@pytest.fixture(scope="module")
def references():
    return ReferenceSet.build([scan_at(office(seed=3), np.array([12.0, 0.0, 0.3]))])


def zigzag(pose) -> Scan:
    """A wall of more corners than a scan has anchors."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 30)
    radius = np.where(np.arange(30) % 2, 4.0, 4.8) + np.random.default_rng(3).uniform(-0.3, 0.3, 30)
    corners = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    return scan_at(np.stack([corners[:-1], corners[1:]], axis=1), np.array(pose))


@pytest.fixture(scope="module")
def status():
    """The statuses of the queries of the table, all matched in one call."""
    world = office(seed=3)
    there = scan_at(world, np.array([12.1, 0.1, 0.2]))
    queries = {
        "no valid beam": make(np.full(181, np.nan)),
        "all beams without return": make(np.full(181, np.inf)),
        "one beam": make([2.0]),
        "millimetres given as metres, all beams": make(1000 * np.nan_to_num(there.ranges)),
        "a plain wall": scan_at(np.array([[[2, -90], [2, 90]]], float), np.zeros(3)),
        "another place that explains the scan about as well": closed_room([3.5, 1.8, 0.6]),
        "more anchors than the capacity": zigzag([0.3, 0.2, 0.1]),
        "no hypothesis that reaches `min_quality`": there,
    }
    near = scan_at(world, np.array([12.0, 0.0, 0.3]))
    references = ReferenceSet.build([near, zigzag(np.zeros(3)), closed_room([3, 2, 0.3])])
    # As many as other tests have, to share their compilation.
    scans = [*queries.values()] * 3
    found = match_batch(scans, references)
    strict = match_batch(scans, references, MatchConfig(min_quality=0.999))
    alone = match_batch(scans, ReferenceSet.build([queries["no valid beam"]]))
    order = list(queries)
    outcome = {name: found.status[index] for index, name in enumerate(order)}
    outcome[order[-1]] = strict.status[len(order) - 1]
    outcome["no reference with such edges"] = alone.status[len(order) - 1]
    for result in (found, strict, alone):
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(result))
    assert found.status[len(order) - 1] == Status.OK
    return {name: Status(int(value)).text for name, value in outcome.items()}


def as_each_alone() -> str:
    scans = [make(np.full(beams, 2.0), angle_min=0.1 * beams) for beams in (3, 80, 1)]
    stacked = Scan.stack(scans)
    for index, scan in enumerate(scans):
        for name in ("hit", "no_return", "points"):
            padded, alone = (np.asarray(getattr(each, name)) for each in (stacked, scan))
            np.testing.assert_allclose(padded[index, : len(alone)], alone, atol=1e-6)
            assert not padded[index, len(alone) :].any()
    return "as each alone"


def as_those(batch) -> str:
    """A stack of half as many bits, or twice, and its beams as floating-point numbers."""
    for kind in (np.float16, np.float64):
        given = jax.tree.map(lambda array: np.asarray(array, kind), batch)  # noqa: B023
        for ours, wanted in zip(*map(jax.tree.leaves, (as_stack(given), batch)), strict=True):
            assert ours.dtype == wanted.dtype
            np.testing.assert_allclose(ours, wanted, rtol=1e-3)
    return "as those"


def descending() -> str:
    bearings = np.asarray(make([1.0, 1.0], angle_increment=-STEP).bearings)
    return "a scan, clockwise" if bearings[1] < bearings[0] else "another"


def both_ends() -> str:
    scan = make(np.ones(361))
    return "a scan, without the last beam" if scan.beams == len(scan.ranges) == 360 else "another"


def test_every_row_of_the_table_is_so(log, readings, references, status):
    good = make(np.ones(181))
    batch = Scan.stack([good, good])
    uneven = {name: getattr(batch, name) for name in Scan.__dataclass_fields__}
    uneven["angle_min"] = np.zeros(3, np.float32)

    def counted(beams: int) -> Scan:
        """The batch with so many beams in its second scan."""
        return eqx.tree_at(lambda scans: scans.beams, batch, np.array([181, beams], np.int32))

    def limited(name: str, value: float) -> Scan:
        """The batch with this angle or limit in its second scan."""
        values = np.array([getattr(batch, name)[0], value], np.float32)
        return eqx.tree_at(lambda scans: getattr(scans, name), batch, values)

    several = FeatureConfig(ExtractionConfig(apart=np.array([0.2, 0.3])))  # pyright: ignore[reportArgumentType]
    unequal = ((20, np.linspace(1, 4, 20)), (3, [1.0, 2.0]))

    def skipped() -> str:
        report = log(*unequal).report
        return "skipped and counted" if (report.scans, report.damaged_lines) == (1, 1) else "not"

    def strictly() -> str:
        with pytest.raises(LogError) as caught:
            log(*unequal, strict=True)
        return f"LogError: {str(caught.value).split(': ')[1]}"

    def all_equal(outcomes) -> str:
        (outcome,) = set(outcomes)
        return outcome

    outcomes: dict[str, Callable[[], str]] = {
        "from `range_min` to `range_max`, both included": lambda: all_equal(
            beam(np.float32(value)) for value in (0.1, 1.0, 30.0)
        ),
        "NaN": lambda: beam(np.nan),
        "+inf": lambda: beam(np.inf),
        "-inf": lambda: beam(-np.inf),
        "0, even where `range_min` is 0": lambda: beam(0.0, range_min=0.0),
        "negative": lambda: beam(-1.0),
        "below `range_min`": lambda: beam(0.05),
        "above `range_max`": lambda: beam(30.1),
        "finite, but too large for float32": lambda: beam(1e39),
        "millimetres given as metres": lambda: beam(2500.0),
        "integers": lambda: beam(np.array([3], np.uint16)),
        "masked by NumPy": lambda: beam(np.ma.array([3.0], mask=[True])),
        "the saturation value of the scanner, which is read often at the very end": lambda: (
            readings(51.05, often=80)
        ),
        "the maximum that the line states": lambda: readings(50.0, maximum=50.0),
        "SICK's 81.83 (above maximum)": lambda: readings(81.83),
        "SICK's 81.87, 81.89, 81.90 and 81.91": lambda: all_equal(
            map(readings, (81.87, 81.89, 81.90, 81.91))
        ),
        "no ranges": lambda: refused(lambda: make([])),
        "ranges of several scans": lambda: refused(lambda: make(np.ones((2, 3)))),
        "ranges that are no numbers": lambda: all_equal(
            refused(lambda: make(ranges))  # noqa: B023
            for ranges in (["a"], [None], [[1.0], [1.0, 2.0]], [1 + 2j])
        ),
        "an angle or limit that is NaN or infinite": lambda: all_equal(
            refused(lambda: make([1.0], **{name: value})).replace(name, "angle_min")  # noqa: B023
            for name in ("angle_min", "angle_increment", "range_min", "range_max")
            for value in (np.nan, np.inf, -np.inf)
        ),
        "an angle or limit that is no number": lambda: all_equal(
            refused(lambda: make([1.0], **{name: value})).replace(name, "angle_min")  # noqa: B023
            for name in ("angle_min", "angle_increment", "range_min", "range_max")
            for value in ("a", "1.0", None, np.zeros(3), np.zeros(1), [1.0], 1j, 10**400)
        ),
        "angles that do not change: an increment of 0": lambda: refused(
            lambda: make([1.0, 1.0], angle_increment=0.0)
        ),
        "an increment that is 0 in float32": lambda: refused(
            lambda: make([1.0], angle_increment=1e-46)
        ),
        "angles that descend: the scanner hangs upside down": descending,
        "more than a full turn": lambda: refused(lambda: make(np.ones(400))),
        "a full turn with both its ends": both_ends,
        "a full turn of few beams, its ends half an increment apart": lambda: (
            "a scan, with all its beams"
            if make(np.ones(4), angle_increment=np.radians(103)).beams == 4
            else "another"
        ),
        "`range_min` negative or not below `range_max`": lambda: all_equal(
            refused(lambda: make([1.0], range_min=value))  # noqa: B023
            for value in (-0.1, 30.0, 31.0)
        ),
        "limits that are equal in float32": lambda: all_equal(
            refused(lambda: make([1.0], range_min=low, range_max=high))  # noqa: B023
            for low, high in ((30.0 - 1e-9, 30.0), (0.0, 1e-50))
        ),
        "a line of a log with more or fewer readings than it says": skipped,
        "the same, read with `strict`": strictly,
        "poses for another number of references": lambda: refused(
            lambda: ReferenceSet.build([good], T_world_ref=np.zeros((2, 3)))
        ),
        "excluded ids for another number of queries": lambda: refused(
            lambda: match_batch([good], references, exclude=np.zeros((2, 1), int))
        ),
        "a stack in which a field has another number of scans": lambda: refused(
            lambda: Scan(**uneven)
        ),
        "a stack in which a scan has fewer beams than none, or more than slots": lambda: all_equal(
            refused(lambda: match_batch(counted(beams), references))  # noqa: B023
            for beams in (-1, 193, 2**31 - 1)
        ),
        "a scan in a list with more beams than ranges": lambda: refused(
            lambda: match_batch([good, jax.tree.map(lambda a: a[1], counted(193))], references)
        ),
        "a stack without slots": lambda: refused(
            lambda: match_batch(
                eqx.tree_at(lambda s: s.ranges, counted(0), np.empty((2, 0), np.float32)),
                references,
            )
        ),
        "a stack in which a scan has an angle or limit that no scan has": lambda: all_equal(
            refused(lambda: match_batch(limited(name, value), references)).replace(  # noqa: B023
                name,
                "range_min",
            )
            for name, value in (
                ("angle_min", np.nan),
                ("angle_increment", 0.0),
                ("angle_increment", 1.0),
                ("range_max", np.inf),
                ("range_min", -1.0),
                ("range_min", 30.0),
            )
        ),
        "a pose farther than 1e8 m from the origin": lambda: all_equal(
            refused(lambda: ReferenceSet.build(batch, T_world_ref=[[0, 0, 0], [0, far, 0]]))  # noqa: B023
            for far in (1e300, -1e9, np.inf)
        ),
        "an excluded id that int32 cannot hold": lambda: all_equal(
            refused(lambda: match_batch([good], references, exclude=np.array([[0, far]])))  # noqa: B023
            for far in (2**32 + 7, -(2**31) - 1, 2**70)
        ),
        "excluded ids that are no whole numbers": lambda: all_equal(
            refused(lambda: match(good, references, exclude=ids))  # noqa: B023
            for ids in ([1.5], ["a"], [True], [[1], [1, 2]])
        ),
        "an id to remove that is not there, or that int32 cannot hold": lambda: all_equal(
            refused(lambda: references.remove([0, far]))  # noqa: B023
            for far in (7, -1, 2**32, 2**70)
        ),
        "ids to remove that are no whole numbers": lambda: all_equal(
            refused(lambda: references.remove(ids))  # noqa: B023
            for ids in ([0.0], [1.7], ["a"], [True])
        ),
        "no scans": lambda: all_equal(
            (
                refused(lambda: match_batch([], references)),
                refused(lambda: ReferenceSet.build([])),
            )
        ),
        "no references": lambda: refused(lambda: match_batch([good], references.remove([0]))),
        "a list of scans for references": lambda: all_equal(
            refused(lambda: call([good], [good], MatchConfig()))  # noqa: B023
            for call in (match_batch, match_sharded, sweep)
        ),
        "scans of different numbers of beams": as_each_alone,
        "a scan that is a batch itself": lambda: refused(
            lambda: match_batch([good, batch], references)
        ),
        "what is no scan, among scans": lambda: all_equal(
            refused(lambda: call([good, None]))  # noqa: B023
            for call in (lambda scans: match_batch(scans, references), ReferenceSet.build)
        ),
        "a stack of other numbers than float32 and int32": lambda: as_those(batch),
        "one of another kind": lambda: all_equal(
            (
                refused(lambda: match(good, references, FeatureConfig())),  # pyright: ignore[reportArgumentType]
                refused(lambda: ReferenceSet.build([good], MatchConfig())),  # pyright: ignore[reportArgumentType]
            )
        ),
        "a threshold that is NaN or infinite": lambda: all_equal(
            refused(lambda: RefineConfig(cluster=value))  # noqa: B023
            for value in (np.nan, np.inf, -np.inf, 1e39)
        ),
        "a threshold out of its range": lambda: all_equal(
            (
                refused(lambda: RefineConfig(cluster=-1.0)),  # pyright: ignore[reportArgumentType]
                refused(lambda: from_dict(MatchConfig, {"refine": {"cluster": -1.0}})),
            )
        ),
        "a value along a sweep that is either": lambda: all_equal(
            refused(lambda: RefineConfig(cluster=np.array([1.0, value, 2.0])))  # noqa: B023
            for value in (np.nan, -1.0)
        ),
        "several values of a threshold, where nothing is swept": lambda: all_equal(
            (
                refused(lambda: match(good, references, MatchConfig(confident=[0.1, 0.2]))),  # pyright: ignore[reportArgumentType]
                refused(lambda: ReferenceSet.build([good], several)).replace(
                    "extraction.apart", "confident"
                ),
            )
        ),
        "a capacity that is no whole number, or below its least": lambda: all_equal(
            refused(lambda: VotingConfig(places=places))  # noqa: B023
            for places in (-1, 0, 2.5, True, "2", None)
        ),
        "anchors not from 2 to 128": lambda: all_equal(
            refused(lambda: ExtractionConfig(anchors=anchors))  # noqa: B023
            for anchors in (-1, 0, 1, 129)
        ),
        "`top_k`, `hypotheses` or `chunk` below 1": lambda: all_equal(
            refused(lambda: MatchConfig(**{name: 0})).replace(name, "top_k")  # noqa: B023
            for name in ("top_k", "hypotheses", "chunk")
        ),
    }
    outcomes |= {name: (lambda text=text: text) for name, text in status.items()}
    table = rows()
    assert table.keys() == outcomes.keys()
    assert {name: find() for name, find in outcomes.items()} == table
