"""Iterative dual correspondence as validation source: where exactly a scan fits a hypothesis.

It needs a start, so it can find no place. Near one it refines the centre of a hypothesis that the
global match did not. It rejects nothing: where the matcher finds nothing, people or an open door
are in view, and that nothing converges says nothing about the place.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import capacity, threshold
from aprjax.plane import compose, compose_covariance, distance
from aprjax.scan import Scan
from aprjax.tracking.hypothesis import Hypothesis
from aprjax.tracking.idc import Idc, IdcConfig, idc
from aprjax.tracking.neighbours import Neighbours, Surroundings
from aprjax.tracking.sources import Verdict
from aprjax.tracking.views import view_of
from aprjax.world.model import WorldModel
from aprjax.world.parts import Place

_EXACT = np.zeros((3, 3))
_DEVIATIONS = 2.0  # of the arcs in between, by which a volume is widened


class IdcSourceConfig(eqx.Module):
    """Which hypotheses are compared with what, and what that says.

    `found` is little more than one: a place that the matcher took for the right one looks like it,
    and there it converges too.
    """

    idc: IdcConfig = IdcConfig()
    reach: Float[Array, ""] = threshold(2.5, "metres to a reference that shows the same")
    turn: Float[Array, ""] = threshold(np.radians(60), "radians to it")
    least: Float[Array, ""] = threshold(0.02, "λ of hypotheses that are worth the effort")
    found: Float[Array, ""] = threshold(1.5, "likelihood ratio where it converges in the volume")
    paired: Float[Array, ""] = threshold(0.6, "share of paired hits from which a pose is taken")
    hypotheses: int = capacity(4, "most hypotheses that are compared with a scan")


class IdcSource:
    """Compares a scan with the reference nearest to each hypothesis.

    Only hypotheses that the same scan's global match has not just given a new centre are asked
    about. A reading is a `Scan`.
    """

    reads = "scan"

    def __init__(self, config: IdcSourceConfig | None = None) -> None:
        self.config = IdcSourceConfig() if config is None else config
        self._world: WorldModel | None = None
        self._near: Neighbours | None = None
        self._references: Surroundings | None = None

    def judge(
        self, reading: Scan, hypotheses: Sequence[Hypothesis], world: WorldModel
    ) -> Sequence[Verdict]:
        """Verdicts; those on hypotheses without a reference nearby say nothing."""
        if self._world is not world or self._near is None or self._references is None:
            self._world = world
            self._near = Neighbours(world, 2.0 * float(self.config.reach))
            places = {number: seen.place for number, seen in world.appearances.items()}
            self._references = Surroundings(self._near, places)
        asked = []
        for number, hypothesis in enumerate(hypotheses):
            moved = hypothesis.unconfirmed > 0 or hypothesis.turned > 0
            worth = hypothesis.probability >= self.config.least
            if moved and worth and len(asked) < self.config.hypotheses:
                reference = self._nearest(hypothesis.place, self._references)
                if reference is not None:
                    asked.append((number, *reference))
        verdicts = [Verdict(1.0)] * len(hypotheses)
        if asked:
            found = self._compare(reading, asked, world)
            for row, (number, reference, _) in enumerate(asked):
                one = jax.tree.map(lambda array: array[row], found)  # noqa: B023
                verdicts[number] = self._verdict(hypotheses[number], reference, one, world)
        return verdicts

    def _nearest(self, place: Place, references: Surroundings) -> tuple[int, np.ndarray] | None:
        """The reference nearest to a place, and the place in its scan's frame."""
        numbers, T_ref_place = references.around(place)
        far, turn = distance(T_ref_place), np.abs(T_ref_place[:, 2])
        usable = (far <= self.config.reach) & (turn <= self.config.turn)
        if not usable.any():
            return None
        best = int(np.argmin(np.where(usable, far + turn, np.inf)))
        return int(numbers[best]), T_ref_place[best]

    def _compare(
        self, scan: Scan, asked: list[tuple[int, int, np.ndarray]], world: WorldModel
    ) -> Idc:
        """The scan against each reference asked about, on the host.

        Padded to one of two sizes, so that it compiles twice at most: mostly one is asked about.
        """
        slots = 1 if len(asked) == 1 else self.config.hypotheses
        known = world.references
        rows, starts = np.zeros(slots, int), np.zeros((slots, 3), np.float32)
        rows[: len(asked)] = np.searchsorted(known.ids, [reference for _, reference, _ in asked])
        starts[: len(asked)] = [start for _, _, start in asked]
        view = jax.device_get(view_of(scan, known.index.described_by))
        queries = jax.tree.map(lambda array: np.repeat(array[None], slots, 0), view)
        views = jax.tree.map(lambda array: np.asarray(array)[rows], known.index.features.view)
        return jax.device_get(idc(views, queries, starts, self.config.idc))

    def _verdict(
        self, hypothesis: Hypothesis, reference: int, found: Idc, world: WorldModel
    ) -> Verdict:
        """What the outcome `found` against one reference says of one hypothesis."""
        at = world.appearances[reference].place
        T_ref_laser = np.asarray(found.T_ref_query, float)
        place = Place(at.node, compose(at.T_node_laser, T_ref_laser))
        inside = self._near is not None and self._near.within(
            hypothesis.place, place, hypothesis.radius, hypothesis.angle, _DEVIATIONS
        )
        if not (found.converged and inside and found.paired >= self.config.paired):
            return Verdict(1.0)
        covariance = np.asarray(found.covariance, float)
        in_node = compose_covariance(at.T_node_laser, _EXACT, T_ref_laser, covariance)
        return Verdict(float(self.config.found), place, in_node, reference)
