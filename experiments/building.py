"""A building of 50 x 70 m in simulation: four office floors in a ring, joined by corridors.

Two of the corridors are long. Either all their doors are shut, flush with plain walls, so that a
scanner sees nothing but two lines; or they have recessed doors and pillars like any other.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import networkx as nx
import numpy as np

import aprjax
from aprjax.plane import compose, relative, transform, wrap
from aprjax.sim.floor_plan import FloorPlan, office
from aprjax.sim.furniture import Piece
from aprjax.sim.laser import Laser
from aprjax.sim.odometry import odometry
from aprjax.sim.rectangle import overlap, transform_rectangle
from aprjax.sim.routes import point_in, route
from aprjax.sim.run import Run, simulate
from aprjax.sim.walls import Door, Feature, outline
from aprjax.world.parts import Appearance, Arc, Place

RING = 36.0, 56.0  # metres along the middle of the corridors; the offices stand out on both sides
OFFSETS = 6.0, 10.0  # metres from a corner to the office on the ring's short and long sides
WIDTH = 1.0  # half, of the corridors between the offices
STRIP = 0.3  # half, of where the robot drives in them
RANGE = 8.0  # metres that a scanner sees which resolves millimetres in 13 bits
SIDES = 4
REARRANGED = 0.25  # share of the movable things that stand elsewhere in a later drive
ROOMS = 3  # entered in each office
_END = 0.55, 0.78  # metres from an office's corridor walls to the strip that its robot keeps to
_PER_RADIAN = 0.5  # metres of way that a radian of turning on the spot counts
_PERIOD = 0.4  # seconds between scans


def parsed(description: str | None, buildings: int, *, quick: str) -> argparse.Namespace:
    """The command line of an experiment in so many of these buildings; `quick` says what is less.

    The folder `out` is made.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--buildings", type=int, default=buildings, metavar="N")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first building's")
    parser.add_argument("--quick", action="store_true", help=quick)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    return arguments


@dataclass(frozen=True)
class Building:
    """The floor plan, and where in its graph of areas the corridors and rooms of each side are."""

    plan: FloorPlan
    rooms: list[list[int]]
    """Areas of the rooms of each of the four offices."""
    halls: list[int]
    """Area of each office's corridor."""
    links: list[tuple[int, int]]
    """Areas of the corridor from each office to the next, up to the corner and on from it."""
    blank: list[np.ndarray]
    """Rectangles `(2, 2)` in which a robot that goes round counter-clockwise sees within `RANGE`
    two plain walls and nothing else."""

    def later(self, seed: int) -> "Building":
        """The building at another time."""
        return replace(self, plan=self.plan.rearranged(seed, REARRANGED))

    def is_blank(self, xy: np.ndarray) -> np.ndarray:
        """Which points `(n, 2)` lie in blank stretches."""
        inside = [np.all((xy >= low) & (xy <= high), axis=-1) for low, high in self.blank]
        return np.any(inside, axis=0) if inside else np.zeros(len(xy), bool)


def building(seed: int, shut: bool) -> Building:
    """The building of a seed; `shut` says whether the doors of the long corridors are."""
    rng = np.random.default_rng(seed)
    floors = [office(int(rng.integers(2**31)), visited=ROOMS) for _ in range(SIDES)]
    corners = np.array([(0, 0), (RING[0], 0), RING, (0, RING[1])], float)
    frames = [np.array([*corner, side * np.pi / 2]) for side, corner in enumerate(corners)]
    lengths = [float(_hall(floor)[1][0]) + _END[0] for floor in floors]
    walls, doors, pieces, blank = [], [], [], []
    areas, rooms, halls = nx.Graph(), [], []
    for side, floor in enumerate(floors):
        T = compose(frames[side], np.array([OFFSETS[side % 2], 0.0, 0.0]))
        gates = [np.array([(x - 0.3, -WIDTH), (x + 0.3, WIDTH)]) for x in (0.0, lengths[side])]
        walls.append(transform(T, _without(floor.walls, gates)))
        doors += [_moved_door(T, door) for door in floor.doors]
        pieces += [_moved_piece(T, piece) for piece in floor.furniture]
        halls.append(len(areas))
        rooms.append(_join(areas, floor.areas, T))
    links = []
    for side in range(SIDES):
        start, corner = OFFSETS[side % 2] + lengths[side], RING[side % 2]
        end = OFFSETS[(side + 1) % 2]
        plain = shut and side % 2 == 1
        walls.append(transform(frames[side], _corridor(rng, start, corner, end, plain)))
        strips = [
            np.array([(start - 1.3, -STRIP), (corner + STRIP, STRIP)]),
            np.array([(corner - STRIP, -STRIP), (corner + STRIP, end + 1.3)]),
        ]
        first, second = (
            _add(areas, transform_rectangle(frames[side], strip), "corridor") for strip in strips
        )
        links.append((first, second))
        if plain:
            seen = np.array([(start + 2.0, -WIDTH), (corner - RANGE - 1.5, WIDTH)])
            blank.append(transform_rectangle(frames[side], seen))
    plan = FloorPlan(np.concatenate(walls), tuple(doors), tuple(pieces), areas)
    return Building(plan, rooms, halls, links, blank)


def lap(seed: int, built: Building, visits: int, clockwise: bool = False) -> list[np.ndarray]:
    """Corners `(2,)` of a way once round the ring, into so many rooms of each office."""
    rng = np.random.default_rng(seed)
    areas = built.plan.areas
    order = list(range(SIDES))[:: -1 if clockwise else 1]
    goals = []
    for side in order:
        chosen = rng.permutation(built.rooms[side])[:visits].tolist()
        link = built.links[side - 1 if clockwise else side]
        goals += [*chosen, built.halls[side], *(link[::-1] if clockwise else link)]
    goals.append(built.halls[order[0]])
    at = built.halls[order[0]], _middle(areas, built.halls[order[0]])
    way = [at[1]]
    for node in goals:
        goal = node, point_in(rng, areas.nodes[node]["rectangle"])
        if areas.nodes[node]["kind"] == "corridor":
            goal = node, _middle(areas, node)
        way += [point.xy for point in route(rng, areas, at, goal, 0.0)]
        at = goal
    return way


def errand(seed: int, built: Building, length: float) -> list[np.ndarray]:
    """Corners of a way of at least `length` metres from a random place to random goals."""
    rng = np.random.default_rng(seed)
    areas = built.plan.areas
    nodes = list(areas.nodes)
    sizes = np.array([np.prod(np.ptp(areas.nodes[n]["rectangle"], axis=0)) for n in nodes])
    node = nodes[int(rng.choice(len(nodes), p=sizes / sizes.sum()))]
    at = node, point_in(rng, areas.nodes[node]["rectangle"])
    way = [at[1]]
    while np.hypot(*np.diff(way, axis=0).T).sum() < length:
        node = nodes[int(rng.integers(len(nodes)))]
        goal = node, point_in(rng, areas.nodes[node]["rectangle"])
        way += [point.xy for point in route(rng, areas, at, goal, 0.0)]
        at = goal
    return way


def poses_along(way: list[np.ndarray], step: float) -> np.ndarray:
    """Poses `(N, 3)` every `step` metres of a robot that turns on the spot at each corner."""
    legs = np.diff(way, axis=0)
    kept = np.hypot(*legs.T) > 0.05
    legs = np.diff(np.array([way[0], *np.array(way[1:])[kept]]), axis=0)
    headings = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    corners = np.concatenate([[way[0]], way[0] + np.cumsum(legs, axis=0)])
    # Each corner twice: before and after the turn.
    knots = np.column_stack([np.repeat(corners, 2, axis=0)[1:-1], np.repeat(headings, 2)])
    effort = np.hypot(*np.diff(knots[:, :2], axis=0).T)
    effort += _PER_RADIAN * np.abs(np.diff(knots[:, 2]))
    gone = np.concatenate([[0.0], np.cumsum(effort)])
    at = np.arange(0.0, gone[-1], step)
    x, y, theta = (np.interp(at, gone, column) for column in knots.T)
    return np.column_stack([x, y, wrap(theta)])


def recorded(
    seed: int, built: Building, pieces: list[np.ndarray], laser: Laser, people: int = 8
) -> Run:
    """The run along pieces of way, poses `(N, 3)` each; wheels say nothing of what lies between."""
    poses = np.concatenate(pieces)
    run = simulate(seed, built.plan, poses, _PERIOD * np.arange(len(poses)), laser, people)
    wheels, at = [], np.zeros(3)
    for number, piece in enumerate(pieces):
        own, _ = odometry(seed + number, piece, _PERIOD * np.arange(len(piece)))
        wheels.append(compose(at, own))
        at = wheels[-1][-1]
    return replace(run, odometry=np.concatenate(wheels))


def entries_of(run: Run) -> list[aprjax.LogEntry]:
    """The run as a log."""
    scans = [
        aprjax.Scan.make(
            np.asarray(run.scans.ranges[k]),
            angle_min=float(run.scans.angle_min[k]),
            angle_increment=float(run.scans.angle_increment[k]),
            range_min=float(run.scans.range_min[k]),
            range_max=float(run.scans.range_max[k]),
        )
        for k in range(len(run.stamps))
    ]
    return [
        aprjax.LogEntry(scan, pose, float(stamp), "ROBOTLASER1", logged_pose=None, line=0)
        for scan, pose, stamp in zip(scans, run.odometry, run.stamps, strict=True)
    ]


def mapped(
    seed: int, run: Run, entries: list[aprjax.LogEntry], references: np.ndarray
) -> tuple[aprjax.WorldModel, np.ndarray]:
    """A world model of a mapping run, and the true poses `(nodes, 3)` of its nodes' frames.

    A node every five metres, arcs where the run goes from one to another, each a few centimetres
    off; `references` are the numbers of its reference scans. So it is torn as maps are, but what
    the experiments say does not hang on how well maps are built.
    """
    rng = np.random.default_rng(seed)
    T, deviations = run.T_world_laser, np.array([0.03, 0.03, np.radians(0.4)])
    frames: list[int] = []
    for scan in range(len(T)):
        if not frames or np.hypot(*(T[frames] - T[scan])[:, :2].T).min() > 3.5:
            frames.append(scan)
    world = aprjax.WorldModel()
    for scan in frames:
        world.add_node(scan)
    home = np.hypot(*np.moveaxis(T[:, None] - T[frames], -1, 0)[:2]).argmin(axis=1)
    for a, b in zip(home[:-1].tolist(), home[1:].tolist(), strict=True):
        if a != b and not world.graph.has_edge(a, b):
            off = rng.normal(0.0, deviations)
            T_a_b = relative(T[frames[a]], T[frames[b]]) + off
            world.add_arc(Arc(a, b, T_a_b, np.diag(deviations**2), "driven"))
    for scan, node in enumerate(home.tolist()):
        world.place_scan(scan, Place(node, relative(T[frames[node]], T[scan])))
    world.add_references(
        [entries[scan].scan for scan in references],
        [Appearance(world.places[scan], scan) for scan in references.tolist()],
    )
    return world, T[frames]


def spaced(
    T_world_laser: np.ndarray, distance: float = 1.5, angle: float = np.radians(40)
) -> np.ndarray:
    """Numbers of the poses that lie so far from those before, as maps keep reference scans."""
    kept: list[int] = []
    for k, pose in enumerate(T_world_laser):
        off = T_world_laser[kept] - pose
        near = np.hypot(off[:, 0], off[:, 1]) < distance
        if not np.any(near & (np.abs(wrap(off[:, 2])) < angle)):
            kept.append(k)
    return np.array(kept)


def _hall(floor: FloorPlan) -> np.ndarray:
    """The strip `(2, 2)` of an office's main corridor, which is its first area."""
    return floor.areas.nodes[0]["rectangle"]


def _middle(areas: nx.Graph, node: int) -> np.ndarray:
    return areas.nodes[node]["rectangle"].mean(axis=0)


def _join(areas: nx.Graph, own: nx.Graph, T_world_own: np.ndarray) -> list[int]:
    """Add a floor's areas; the new numbers of its rooms."""
    first = len(areas)
    for node, area in own.nodes(data=True):
        rectangle = transform_rectangle(T_world_own, area["rectangle"])
        areas.add_node(first + node, kind=area["kind"], rectangle=rectangle)
    for a, b, edge in own.edges(data=True):
        shared = transform_rectangle(T_world_own, edge["overlap"])
        areas.add_edge(first + a, first + b, overlap=shared)
    return [first + node for node, kind in own.nodes(data="kind") if kind == "room"]


def _add(areas: nx.Graph, rectangle: np.ndarray, kind: str) -> int:
    """Add an area, and edges to the corridors that it overlaps; its number."""
    number = len(areas)
    shared = {
        other: overlap(rectangle, area["rectangle"])
        for other, area in areas.nodes(data=True)
        if area["kind"] == "corridor"
    }
    areas.add_node(number, kind=kind, rectangle=rectangle)
    areas.add_edges_from(
        (other, number, {"overlap": both}) for other, both in shared.items() if both is not None
    )
    return number


def _corridor(
    rng: np.random.Generator, start: float, corner: float, end: float, plain: bool
) -> np.ndarray:
    """Walls `(S, 2, 2)` of a corridor along x from `start`, left at `corner`, up to y = `end`."""
    outer, inner = corner + WIDTH, corner - WIDTH
    ways = [
        ((start, -WIDTH), (outer, -WIDTH)),
        ((outer, -WIDTH), (outer, end)),
        ((inner, end), (inner, WIDTH)),
        ((inner, WIDTH), (start, WIDTH)),
    ]
    faces = []
    for a, b in np.array(ways, float):
        # Both sides of the line between two corners; the second is that of nobody.
        features = _features(rng, float(np.hypot(*(b - a))), plain)
        faces.append(outline(np.array([a, b]), [features, []])[:-1])
    return np.concatenate(faces)


def _features(rng: np.random.Generator, length: float, plain: bool) -> list[Feature]:
    """What interrupts a wall every few metres: shut doors in a plain one, recesses and pillars."""
    features = []
    for at in np.arange(0.4, length - 2.5, 2.5):
        begin = at + rng.uniform(0.0, 1.2)
        if plain:
            features.append(Feature(begin, begin + 0.95, 0.0))
        elif rng.random() < 0.5:
            features.append(Feature(begin, begin + 0.95, 0.15))
        elif rng.random() < 0.6:
            features.append(Feature(begin, begin + rng.uniform(0.2, 0.6), -0.15))
    return features


def _without(walls: np.ndarray, gates: list[np.ndarray]) -> np.ndarray:
    """Segments `(S, 2, 2)` less what lies inside the rectangles."""
    for low, high in gates:
        left = []
        for a, b in walls:
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = np.sort(np.stack([(low - a) / (b - a), (high - a) / (b - a)]), axis=0)
            flat = np.abs(b - a) < 1e-9
            within = (a > low) & (a < high)
            enter = np.where(flat, np.where(within, -np.inf, np.inf), ends[0]).max()
            leave = np.where(flat, np.where(within, np.inf, -np.inf), ends[1]).min()
            if enter >= leave or leave <= 0 or enter >= 1:
                left.append((a, b))
                continue
            if enter > 1e-6:
                left.append((a, a + enter * (b - a)))
            if leave < 1 - 1e-6:
                left.append((a + leave * (b - a), b))
        walls = np.array(left)
    return walls


def _moved_door(T: np.ndarray, door: Door) -> Door:
    return replace(door, hinge=transform(T, door.hinge), shut=door.shut + float(T[2]))


def _moved_piece(T: np.ndarray, piece: Piece) -> Piece:
    territory = piece.territory
    if territory is not None:
        territory = territory._replace(T_world_territory=compose(T, territory.T_world_territory))
    return replace(piece, T_world_piece=compose(T, piece.T_world_piece), territory=territory)
