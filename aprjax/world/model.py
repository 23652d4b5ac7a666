"""The hybrid world model (paper section 3): a graph of places with local frames, and no other.

Nodes are distinctive places, each with a metric frame of its own; an arc holds the approximate
pose of its ends' frames to each other. What the sensors saw sits at the arcs' ends, with its pose
in the node's frame. There is no global frame; `super_space` composes local ones along the arcs.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby

import networkx as nx
import numpy as np

from aprjax.features import FeatureConfig
from aprjax.plane import compose, compose_covariance, relative, wrap
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.world.parts import (
    MOST_ID,
    Appearance,
    Arc,
    ArcEnd,
    Place,
    WorldModelError,
    check_arc,
    check_id,
    check_pose,
    check_scan,
)


class WorldModel:
    """A graph of nodes with local frames, arcs between them, and what was seen at their ends.

    `graph` is an undirected networkx graph with an attribute `arc` on each edge and `scan` on each
    node, the number of the log's scan whose laser pose is the node's frame (or None). It is for
    reading; the methods that edit keep what `check` demands. Whoever has read `references`, the
    scans described for the matcher, has paid for it: they are described when first asked for.
    """

    def __init__(self, features: FeatureConfig | None = None) -> None:
        self.graph: nx.Graph = nx.Graph()
        self.appearances: dict[int, Appearance] = {}
        """Reference scans by their id in `references`."""
        self.images: dict[int, Appearance] = {}
        """Image classes by a number of their own."""
        self.places: dict[int, Place] = {}
        """Where each scan of the log was taken."""
        self.features = FeatureConfig() if features is None else features
        self.next_reference = 0
        self._scans: dict[int, Scan] = {}
        self._described: ReferenceSet | None = None

    # Reading

    @property
    def nodes(self) -> list[int]:
        """Ids, ascending."""
        return sorted(self.graph)

    def arcs(self) -> Iterator[Arc]:
        """All arcs, by their nodes' ids."""
        for _, _, arc in sorted(self.graph.edges(data="arc"), key=lambda edge: sorted(edge[:2])):
            yield arc

    def arc(self, a: int, b: int) -> Arc:
        """The arc between two nodes, seen from `a`. Raises `WorldModelError` if there is none."""
        if not self.graph.has_edge(a, b):
            raise WorldModelError(f"arc: there is none between {a} and {b}")
        return self.graph.edges[a, b]["arc"].seen_from(a)

    @property
    def reference_scans(self) -> dict[int, Scan]:
        """The reference scans by id."""
        return dict(self._scans)

    @property
    def references(self) -> ReferenceSet:
        """The reference scans as the matcher takes them. Raises `WorldModelError` if none."""
        if not self._scans:
            raise WorldModelError("references: the world model has none")
        described = self._described
        known = set() if described is None else set(described.ids.tolist())
        gone, new = known - self._scans.keys(), sorted(self._scans.keys() - known)
        if described is None or gone == known:
            described = ReferenceSet.restore(
                Scan.stack([self._scans[i] for i in sorted(self._scans)]),
                np.array(sorted(self._scans)),
                self.next_reference,
                self.features,
            )
        else:
            described = described.remove(sorted(gone)) if gone else described
            # The set gives consecutive ids; one that was taken back meanwhile is passed over.
            for _, run in groupby(enumerate(new), lambda pair: pair[1] - pair[0]):
                ids = [reference for _, reference in run]
                described = replace(described, next_id=ids[0]).add([self._scans[i] for i in ids])
            if described.next_id != self.next_reference:
                described = replace(described, next_id=self.next_reference)
        self._described = described
        return described

    def arc_end(self, appearance: Appearance) -> ArcEnd:
        """The end of the arc that an appearance looks along, forward or back, most nearly."""
        node, heading = appearance.place.node, appearance.place.T_node_laser[2]
        best = (np.inf, ArcEnd(node, None, True))
        for neighbour in sorted(self.graph[node]):
            x, y, _ = self.arc(node, neighbour).T_a_b
            off = abs(float(wrap(np.asarray(heading - np.arctan2(y, x)))))
            end = ArcEnd(node, neighbour, off <= np.pi / 2)
            best = min(best, (min(off, np.pi - off), end), key=lambda pair: pair[0])
        return best[1]

    def seen_along(self, node: int, neighbour: int) -> list[int]:
        """Ids of the references at `node`'s end of the arc to `neighbour`, in both directions."""
        self.arc(node, neighbour)
        return [
            reference
            for reference, appearance in sorted(self.appearances.items())
            if appearance.place.node == node and self.arc_end(appearance).neighbour == neighbour
        ]

    # Editing

    def add_node(self, scan: int | None = None, node: int | None = None) -> int:
        """A node without arcs; its id, by default one more than the largest there is."""
        node = max(self.graph, default=-1) + 1 if node is None else node
        node = check_id(f"node {node}", node)
        if node in self.graph:
            raise WorldModelError(f"node {node}: there is one already")
        check_scan(f"node {node}", scan)
        self.graph.add_node(node, scan=scan)
        return node

    def add_arc(self, arc: Arc) -> None:
        """An arc between two nodes that have none yet."""
        check_arc(arc)
        self._check_nodes("arc", arc.a, arc.b)
        if self.graph.has_edge(arc.a, arc.b):
            raise WorldModelError(f"arc: there is one between {arc.a} and {arc.b} already")
        self.graph.add_edge(arc.a, arc.b, arc=arc)

    def replace_arc(self, arc: Arc) -> None:
        """Another estimate of an arc that is there."""
        check_arc(arc)
        self.arc(arc.a, arc.b)
        self.graph.edges[arc.a, arc.b]["arc"] = arc

    def remove_arc(self, a: int, b: int) -> None:
        """Take an arc away; its nodes stay."""
        self.arc(a, b)
        self.graph.remove_edge(a, b)

    def place_scan(self, scan: int, place: Place) -> None:
        """Say where a scan of the log was taken."""
        self._check_place(f"scan {scan}", place, scan)
        self.places[scan] = place

    def add_references(self, scans: Iterable[Scan], appearances: Iterable[Appearance]) -> list[int]:
        """Reference scans, one for each appearance; their ids, which are never given twice."""
        scans, appearances = list(scans), list(appearances)
        ids = list(range(self.next_reference, self.next_reference + len(scans)))
        self.restore_references(ids, scans, appearances, self.next_reference + len(ids))
        return ids

    def restore_references(
        self,
        ids: Sequence[int],
        scans: Sequence[Scan],
        appearances: Sequence[Appearance],
        next_reference: int,
    ) -> None:
        """References under ids that they had before, as a file holds them.

        `next_reference` is the id that the next one added is given.
        """
        if not len(ids) == len(scans) == len(appearances):
            raise WorldModelError(
                f"references: {len(ids)} ids, {len(scans)} scans and {len(appearances)} "
                "appearances do not fit"
            )
        ids = [check_id(f"reference {reference}", reference) for reference in ids]
        taken = set(self.appearances)
        for reference, appearance in zip(ids, appearances, strict=True):
            if reference in taken:
                raise WorldModelError(f"reference {reference}: there is one already")
            if reference >= next_reference:
                raise WorldModelError(f"reference {reference}: the next id is {next_reference}")
            self._check_place(f"reference {reference}", appearance.place, appearance.scan)
            taken.add(reference)
        if next_reference < self.next_reference:
            raise WorldModelError(
                f"references: the next id {next_reference} is less than {self.next_reference}, "
                "and ids are never given twice"
            )
        _check_next(next_reference)
        if self._described is not None and any(i < self._described.next_id for i in ids):
            self._described = None  # an id may mean another scan than the one described
        self._scans.update(zip(ids, scans, strict=True))
        self.appearances.update(zip(ids, appearances, strict=True))
        self.next_reference = next_reference

    def remove_references(self, ids: Iterable[int]) -> None:
        """Forget reference scans. Raises `WorldModelError` for an unknown id, and keeps all."""
        ids = list(ids)
        for reference in ids:
            if reference not in self.appearances:
                raise WorldModelError(f"reference {reference}: there is none")
        for reference in ids:
            self.appearances.pop(reference, None)
            self._scans.pop(reference, None)

    def add_image(self, appearance: Appearance, number: int | None = None) -> int:
        """An image's class seen at a place; its number, by default one more than the largest."""
        number = max(self.images, default=-1) + 1 if number is None else number
        number = check_id(f"image {number}", number)
        if number in self.images:
            raise WorldModelError(f"image {number}: there is one already")
        if appearance.image_class is None:
            raise WorldModelError(f"image {number}: it has no class")
        self._check_place(f"image {number}", appearance.place, appearance.scan)
        self.images[number] = appearance
        return number

    def move_frame(self, node: int, scan: int, covariance: np.ndarray) -> None:
        """Give a node the frame of a scan that is placed in it; what is where stays.

        `covariance` `(3, 3)` is that of the scan's pose in the old frame, which its arcs take on.
        """
        self._check_nodes("node", node)
        if scan not in self.places or self.places[scan].node != node:
            raise WorldModelError(f"node {node}: scan {scan} is not placed in it")
        T_old_new = self.places[scan].T_node_laser
        arcs = []
        for neighbour in sorted(self.graph[node]):
            arc = self.arc(neighbour, node)
            T = compose(arc.T_a_b, T_old_new)
            both = compose_covariance(arc.T_a_b, arc.covariance, T_old_new, covariance)
            arcs.append(Arc(neighbour, node, T, 0.5 * (both + both.T), arc.kind))
            check_arc(arcs[-1])
        for arc in arcs:
            self.replace_arc(arc)

        def into_new(place: Place) -> Place:
            if place.node != node:
                return place
            return Place(node, relative(T_old_new, place.T_node_laser))

        self._move(into_new)
        self.graph.nodes[node]["scan"] = scan

    def split_node(
        self,
        node: int,
        T_node_new: np.ndarray,
        covariance: np.ndarray,
        moved_arcs: Iterable[int] = (),
    ) -> int:
        """A new node at `T_node_new` `(3,)`, with an arc of this `covariance` to the old one.

        The arcs to the neighbours `moved_arcs` then start there. What was seen or placed nearer
        to the new origin than to the old one belongs to it. Returns its id.
        """
        self._check_nodes("node", node)
        link = Arc(node, max(self.graph) + 1, np.asarray(T_node_new, float), covariance, "driven")
        check_arc(link)
        back, arcs = link.seen_from(link.b), []
        for neighbour in dict.fromkeys(moved_arcs):
            arc = self.arc(node, neighbour)
            T = compose(back.T_a_b, arc.T_a_b)
            both = compose_covariance(back.T_a_b, back.covariance, arc.T_a_b, arc.covariance)
            arcs.append(Arc(link.b, neighbour, T, both, arc.kind))
            check_arc(arcs[-1])
        new = self.add_node()
        for arc in arcs:
            self.remove_arc(node, arc.b)
            self.add_arc(arc)
        self.add_arc(link)

        def near_new(place: Place) -> Place:
            if place.node != node:
                return place
            T_new_laser = relative(link.T_a_b, place.T_node_laser)
            nearer = np.hypot(*T_new_laser[:2]) < np.hypot(*place.T_node_laser[:2])
            return Place(new, T_new_laser) if nearer else place

        self._move(near_new)
        return new

    def merge_nodes(self, kept: int, gone: int) -> None:
        """Make two neighbours one node with the frame of `kept`.

        Arcs of `gone` go on from `kept`, except to nodes that `kept` has an arc to already.
        """
        link, arcs = self.arc(kept, gone), []
        for neighbour in sorted(set(self.graph[gone]) - {kept} - set(self.graph[kept])):
            arc = self.arc(gone, neighbour)
            T = compose(link.T_a_b, arc.T_a_b)
            both = compose_covariance(link.T_a_b, link.covariance, arc.T_a_b, arc.covariance)
            kind = "closed" if "closed" in (link.kind, arc.kind) else "driven"
            arcs.append(Arc(kept, neighbour, T, both, kind))
            check_arc(arcs[-1])
        for arc in arcs:
            self.add_arc(arc)

        def into_kept(place: Place) -> Place:
            if place.node != gone:
                return place
            return Place(kept, compose(link.T_a_b, place.T_node_laser))

        self._move(into_kept)
        self.graph.remove_node(gone)

    def check(self) -> None:
        """Raise `WorldModelError` unless all parts fit each other."""
        for a, b, arc in self.graph.edges(data="arc"):
            if not isinstance(arc, Arc) or {arc.a, arc.b} != {a, b}:
                raise WorldModelError(f"arc: the edge of {a} and {b} holds another arc, or none")
            check_arc(arc)
        if self._scans.keys() != self.appearances.keys():
            raise WorldModelError("references: scans and appearances have different ids")
        if self.appearances and max(self.appearances) >= self.next_reference:
            raise WorldModelError(f"references: the next id {self.next_reference} is taken")
        _check_next(self.next_reference)
        for node in self.graph:
            check_scan(f"node {node}", self.graph.nodes[node]["scan"])
        named = [
            *((f"reference {i}", seen.place, seen.scan) for i, seen in self.appearances.items()),
            *((f"image {i}", seen.place, seen.scan) for i, seen in self.images.items()),
            *((f"scan {i}", place, i) for i, place in self.places.items()),
        ]
        for name, place, scan in named:
            self._check_place(name, place, scan)

    def _move(self, change) -> None:
        """Put everything that has a place where `change` says."""
        for seen in (self.appearances, self.images):
            for key, appearance in seen.items():
                seen[key] = replace(appearance, place=change(appearance.place))
        for scan, place in self.places.items():
            self.places[scan] = change(place)

    def _check_nodes(self, name: str, *nodes: int) -> None:
        for node in nodes:
            if node not in self.graph:
                raise WorldModelError(f"{name}: there is no node {node}")

    def _check_place(self, name: str, place: Place, scan: int | None) -> None:
        self._check_nodes(name, place.node)
        check_pose(name, place.T_node_laser)
        check_scan(name, scan)


def _check_next(reference: int) -> None:
    if not 0 <= reference <= MOST_ID:
        raise WorldModelError(f"references: the next id {reference} is not from 0 to {MOST_ID}")
