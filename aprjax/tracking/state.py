"""Beliefs as plain numbers, exact to the bit."""

from typing import Any

import numpy as np

from aprjax.tracking.belief import Belief
from aprjax.tracking.hypothesis import Hypothesis
from aprjax.world.parts import Place


def state_of_belief(belief: Belief) -> dict[str, Any]:
    """A belief as `json` writes it."""
    return {
        "rest": belief.rest,
        "born": belief.born,
        "hypotheses": [
            {
                "number": h.number,
                "node": h.place.node,
                "pose": np.asarray(h.place.T_node_laser, float).tolist(),
                "covariance": h.covariance.tolist(),
                "radius": h.radius,
                "angle": h.angle,
                "probability": h.probability,
                "reference": h.reference,
                "unconfirmed": h.unconfirmed,
                "turned": h.turned,
            }
            for h in belief.hypotheses
        ],
    }


def belief_of_state(state: dict[str, Any]) -> Belief:
    """The belief that `state_of_belief` made `state` of. Raises `KeyError` for another."""
    hypotheses = tuple(
        Hypothesis(
            h["number"],
            Place(h["node"], np.array(h["pose"], float)),
            np.array(h["covariance"], float),
            h["radius"],
            h["angle"],
            h["probability"],
            h["reference"],
            h["unconfirmed"],
            h["turned"],
        )
        for h in state["hypotheses"]
    )
    return Belief(hypotheses, state["rest"], state["born"])
