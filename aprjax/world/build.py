"""A world model from a drive: scans and odometry, and recognition that closes the cycles.

Scan after scan the robot is carried on by its motion. In a part of the map that it knows it is
followed among the references there; elsewhere it makes new nodes and references, until enough of
its scans say that it is back at a known place. Where consecutive scans show nothing in common and
odometry alone says little, the map claims nothing: it falls into parts, unless they meet elsewhere.
"""

from collections.abc import Callable, Iterable, Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import threshold
from aprjax.features import FeatureConfig
from aprjax.io.log import LogEntry
from aprjax.io.messages import FARTHEST
from aprjax.plane import (
    compose,
    compose_covariance,
    distance,
    inverse,
    inverse_covariance,
    relative,
    spread,
    turn_spread,
)
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.world.arcs import FLOOR, fit_arcs
from aprjax.world.closure import ClosureConfig, Located, recognize
from aprjax.world.follow import FollowConfig, Found, follow
from aprjax.world.model import WorldModel
from aprjax.world.motion import Motion, MotionConfig, agreeing, doubted, motion
from aprjax.world.parts import Appearance, Arc, Place
from aprjax.world.recognition import RecognitionConfig, Sightings, sightings
from aprjax.world.smoothing import Measurements
from aprjax.world.super_space import neighbourhood
from aprjax.world.tidy import (
    drop_shortcuts,
    drop_small_cycles,
    merge_close_nodes,
    merge_crossings,
    steady_frames,
)

_ABOUT = 0.4  # metres about a scan in which the robot may turn


class MapConfig(eqx.Module):
    """How a map is built, stage by stage."""

    features: FeatureConfig = FeatureConfig()
    motion: MotionConfig = MotionConfig()
    recognition: RecognitionConfig = RecognitionConfig()
    closure: ClosureConfig = ClosureConfig()
    follow: FollowConfig = FollowConfig()
    reach: Float[Array, ""] = threshold(3.0, "metres from a node up to which scans belong to it")
    slack: Float[Array, ""] = threshold(1.0, "metres more where the robot is turning")
    steady: Float[Array, ""] = threshold(np.radians(6), "radians about a scan that are no turning")
    back: Float[Array, ""] = threshold(
        0.3, "metres: deviation up to which dead reckoning leads back to an older node"
    )
    back_turn: Float[Array, ""] = threshold(np.radians(4), "radians, likewise")
    unsupported: Float[Array, ""] = threshold(
        0.6, "metres: deviation from which an arc says nothing, and is left out"
    )
    unsupported_turn: Float[Array, ""] = threshold(np.radians(6), "radians, likewise")
    one_place: Float[Array, ""] = threshold(1.5, "metres up to which two nodes are made one")
    sure: Float[Array, ""] = threshold(0.4, "metres: deviation of their distance at most")
    detour: Float[Array, ""] = threshold(1.3, "of an arc's length, that makes it superfluous")
    around: Float[Array, ""] = threshold(
        12.0, "metres round a cycle below which it encloses nothing"
    )
    gap: Float[Array, ""] = threshold(1.5, "metres between reference scans")
    turn: Float[Array, ""] = threshold(np.radians(40), "radians between reference scans")


def build_map(
    log: Iterable[LogEntry],
    config: MapConfig | None = None,
    progress: Callable[[int], None] | None = None,
) -> WorldModel:
    """The world model of a drive, from its scans and its raw odometry alone.

    References and places carry the numbers of the log's scans, from 0. `progress` is told how many
    more scans have been dealt with; each counts twice. Raises `ValueError` for a log without scans,
    and for a scan whose odometry is missing or not three finite numbers up to 1e15. A step of over
    a kilometre is taken for a restart of odometry, which says nothing. Scans in which nothing can
    be seen are placed by odometry.
    """
    entries = list(log)
    if not entries:
        raise ValueError("log: there is no scan")
    odometry = np.array([_odometry(entry, number) for number, entry in enumerate(entries)])
    return build_from_scans([entry.scan for entry in entries], odometry, config, progress)


def _odometry(entry: LogEntry, number: int) -> np.ndarray:
    if entry.odometry is None:
        raise ValueError(f"log: scan {number} has no odometry")
    pose = np.asarray(entry.odometry, float)
    if pose.shape != (3,) or not np.all(np.abs(pose) <= FARTHEST):
        raise ValueError(
            f"log: scan {number}: odometry {pose.tolist()} is not three numbers up to {FARTHEST:g}"
        )
    return pose


def build_from_scans(
    scans: Sequence[Scan],
    odometry: np.ndarray,
    config: MapConfig | None = None,
    progress: Callable[[int], None] | None = None,
) -> WorldModel:
    """`build_map` from scans and odometry poses `(N, 3)` in metres and radians."""
    config = MapConfig() if config is None else config
    described = ReferenceSet.build(scans, config.features)
    moved = motion(described.index.features.view, odometry, config.motion)
    seen = sightings(described, moved, config.recognition, progress)
    return build_from_stages(scans, described, moved, seen, config, progress)


def build_from_stages(
    scans: Sequence[Scan],
    described: ReferenceSet,
    moved: Motion,
    seen: Sightings,
    config: MapConfig,
    progress: Callable[[int], None] | None = None,
) -> WorldModel:
    """The last stage: all scans placed one after the other, and the map that comes of it.

    `described` holds all scans under their numbers; `moved` and `seen` are what the stages before
    made of them.
    """
    mapper = _Mapper(moved, seen, described.index.features.view, config)
    for scan in range(len(scans)):
        if scan > 0:  # the first one is where the map begins
            mapper.advance(scan)
        if progress is not None:
            progress(1)
    world = mapper.world
    measured = Measurements.join([moved.measured, *mapper.links])
    steady_frames(world, moved, mapper.covariance)
    fit_arcs(world, measured)
    for arc in list(world.arcs()):
        if not supported(arc.covariance, config):
            world.remove_arc(arc.a, arc.b)
    merge_close_nodes(world, float(config.one_place), float(config.sure))
    drop_shortcuts(world, float(config.detour))
    drop_small_cycles(world, float(config.around))
    merge_crossings(world, float(config.reach), float(config.sure))
    world.add_references(
        [scans[scan] for scan in mapper.references],
        [Appearance(world.places[scan], scan) for scan in mapper.references],
    )
    world.check()
    return world


def supported(covariance: np.ndarray, config: MapConfig) -> bool:
    """Whether a pose is certain enough to say anything."""
    off, turn = spread(covariance), turn_spread(covariance)
    return bool(off <= config.unsupported and turn <= config.unsupported_turn)


class _Mapper:
    """The map so far, and where in it the robot is."""

    def __init__(self, moved: Motion, seen: Sightings, views, config: MapConfig) -> None:
        self.world = WorldModel(config.features)
        self.links: list[Measurements] = []
        """Scans measured from references of a part that was known."""
        self.references: list[int] = []
        """Numbers of the scans that are references."""
        self._moved, self._seen, self._views, self._config = moved, seen, views, config
        self.covariance: dict[int, np.ndarray] = {}
        """`(3, 3)` of each scan's pose in its node's frame."""
        self._by_node: dict[int, list[int]] = {}
        self._last_known = -1
        self._place(0, Located(Place(self.world.add_node(0), np.zeros(3)), np.zeros((3, 3))))

    def advance(self, scan: int) -> None:
        """Place the next scan, in a node that there is or in a new one."""
        before = self.world.places[scan - 1]
        expected = Located(before, self.covariance[scan - 1]).moved(
            self._moved.step(scan - 1, scan), self._moved.covariance[scan]
        )
        found = self._follow(scan, expected)
        if found is None and self._last_known < scan - 1:
            place = recognize(
                scan,
                expected,
                self._last_known,
                self._seen,
                self.world.places,
                self._moved,
                self.world,
                self._config.closure,
            )
            if place is not None:
                found = self._follow(scan, Located(place, np.zeros((3, 3))))
        if found is None:
            self._place(scan, self._home(scan, expected, expected, known=False))
            return
        self._last_known = scan
        self.links.append(
            agreeing(
                found.references,
                np.full(len(found.references), scan),
                found.aligned,
                self._config.motion,
            )
        )
        self._place(scan, self._home(scan, expected, self._located(found), known=True))

    def _follow(self, scan: int, expected: Located) -> Found | None:
        return follow(
            scan,
            expected,
            self._by_node,
            self.world.places,
            self._seen,
            self._moved,
            self._views,
            self.world,
            self._config.follow,
        )

    def _located(self, found: Found) -> Located:
        """The place that the best of the references found gives."""
        reference = int(found.references[0])
        place, T = self.world.places[reference], found.aligned.T_first_second[0]
        covariance = doubted(
            found.aligned.covariance[0], found.aligned.agreement[0], self._config.motion
        )
        return Located(place, self.covariance[reference]).moved(T, covariance)

    def _home(self, scan: int, expected: Located, located: Located, *, known: bool) -> Located:
        """The pose in the frame of the node it belongs to; a new node and arcs as they are due."""
        home = self._nearest(scan, located, known=known)
        new = home is None
        if home is None:
            node = self.world.add_node(scan)
            home = Located(Place(node, np.zeros(3)), np.zeros((3, 3)))
        # The robot drove from the node it was at, and recognition knows it in the one it found.
        self._connect(expected, home, "closed" if known and not new else "driven")
        if new and known:
            self._connect(located, home, "closed")
        return home

    def _nearest(self, scan: int, located: Located, *, known: bool) -> Located | None:
        """The pose in a node within reach: its own, or else the nearest around it."""
        # A scan that was taken while turning is skewed, and makes a poor frame.
        turning = self._moved.turn(scan, _ABOUT) > self._config.steady
        reach = float(self._config.reach + self._config.slack * turning)
        lost = not known and not supported(located.covariance, self._config)
        if distance(located.place.T_node_laser) <= reach and not lost:
            return located
        if not known and (
            spread(located.covariance) > self._config.back
            or turn_spread(located.covariance) > self._config.back_turn
        ):
            return None
        best = None
        for node, link in neighbourhood(self.world, located.place.node, 2).items():
            T = relative(link.T_start_end, located.place.T_node_laser)
            if distance(T) <= reach and (best is None or distance(T) < distance(best[1])):
                best = node, T, link
        if best is None:
            return None
        node, T, link = best
        back = inverse(link.T_start_end)
        covariance = compose_covariance(
            back,
            inverse_covariance(link.T_start_end, link.covariance),
            located.place.T_node_laser,
            located.covariance,
        )
        return Located(Place(node, T), covariance)

    def _connect(self, start: Located, end: Located, kind: str) -> None:
        """An arc between the nodes of one pose given in both, unless there is one."""
        a, b = start.place.node, end.place.node
        if a == b or self.world.graph.has_edge(a, b):
            return
        T_b_here, T_a_here = end.place.T_node_laser, start.place.T_node_laser
        back = inverse(T_b_here)
        T_a_b = compose(T_a_here, back)
        of_back = inverse_covariance(T_b_here, end.covariance)
        covariance = compose_covariance(T_a_here, start.covariance, back, of_back) + FLOOR
        self.world.add_arc(Arc(a, b, T_a_b, 0.5 * (covariance + covariance.T), kind))

    def _place(self, scan: int, located: Located) -> None:
        """Remember where a scan was taken, and keep it as a reference where it adds something."""
        self.world.place_scan(scan, located.place)
        self.covariance[scan] = located.covariance
        for node, link in neighbourhood(self.world, located.place.node, 2).items():
            for reference in self._by_node.get(node, ()):
                T = compose(link.T_start_end, self.world.places[reference].T_node_laser)
                off = relative(T, located.place.T_node_laser)
                if distance(off) < self._config.gap and abs(off[2]) < self._config.turn:
                    return
        self._by_node.setdefault(located.place.node, []).append(scan)
        self.references.append(scan)
