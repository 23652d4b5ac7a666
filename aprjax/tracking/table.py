"""Beliefs as rows of a hypothesis table, told from the reference scans of the map."""

from collections.abc import Sequence

from aprjax.io.tables import HypothesisRow
from aprjax.tracking.belief import Belief
from aprjax.tracking.neighbours import Neighbours, seen_from
from aprjax.world.model import WorldModel
from aprjax.world.parts import WorldModelError

_REACH = 12.0  # metres along arcs to a reference that a pose is told from


def hypothesis_rows(world: WorldModel, beliefs: Sequence[Belief]) -> list[HypothesisRow]:
    """A row for each hypothesis after each scan, the strongest first; one without where none is.

    Raises `WorldModelError` for a hypothesis with no reference scan near it.
    """
    near = Neighbours(world, _REACH)
    rows = []
    for scan, belief in enumerate(beliefs):
        for rank, hypothesis in enumerate(belief.hypotheses):
            seen = seen_from(hypothesis, near, world)
            if seen is None:
                raise WorldModelError(f"node {hypothesis.place.node}: no reference scan is near it")
            reference, T_ref_laser = seen
            rows.append(
                HypothesisRow(
                    scan=scan,
                    rank=rank,
                    reference=world.appearances[reference].scan,
                    T_ref_laser=T_ref_laser,
                    radius=hypothesis.radius,
                    angle=hypothesis.angle,
                    probability=hypothesis.probability,
                    rest=belief.rest,
                    node=hypothesis.place.node,
                    situation=belief.situation.value,
                )
            )
        if not belief.hypotheses:
            rows.append(HypothesisRow(scan, 0, rest=belief.rest, situation=belief.situation.value))
    return rows
