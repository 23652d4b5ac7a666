"""What the tracker believes: explicit hypotheses, the rest, and the answer "I am lost"."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from aprjax.tracking.hypothesis import Hypothesis


class Situation(Enum):
    """How much is known of where the robot is."""

    TRACKING = "tracking"
    """One hypothesis is more probable than all else together."""
    AMBIGUOUS = "ambiguous"
    """The robot is rather in one of the volumes than elsewhere, but none of them stands out."""
    LOST = "lost"
    """The rest is at least as probable as all hypotheses together."""


@dataclass(frozen=True, eq=False)
class Belief:
    """A probability distribution over the volumes of the hypotheses and everything else."""

    hypotheses: tuple[Hypothesis, ...] = ()
    """The most probable first; their λ_i and `rest` sum to one."""
    rest: float = 1.0
    """λ_0: that the robot is in none of the volumes."""
    born: int = 0
    """Hypotheses that there have ever been: the next one's number."""

    @property
    def best(self) -> Hypothesis | None:
        """The most probable hypothesis; the oldest of equals."""
        return self.hypotheses[0] if self.hypotheses else None

    @property
    def situation(self) -> Situation:
        """Tracking, ambiguous or lost."""
        if self.best is not None and self.best.probability > 0.5:
            return Situation.TRACKING
        return Situation.AMBIGUOUS if self.rest < 0.5 else Situation.LOST

    @property
    def probability(self) -> float:
        """Of what `situation` says: λ of the best, of all hypotheses together, or of the rest."""
        if self.situation is Situation.LOST:
            return self.rest
        if self.best is not None and self.situation is Situation.TRACKING:
            return self.best.probability
        return 1.0 - self.rest

    @property
    def covariance(self) -> np.ndarray | None:
        """`(3, 3)` of the best centre in its node's frame, for who fuses it; None unless tracking.

        It holds if the robot is in that volume, which has `probability`.
        """
        if self.best is None or self.situation is not Situation.TRACKING:
            return None
        return self.best.covariance
