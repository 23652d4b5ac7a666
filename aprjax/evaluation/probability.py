"""From e_m to the probability of being right.

Not in the paper, which compares e_m with a threshold. The logistic curve over ln e_m was fitted to
simulated floors alone (`experiments/calibration.py`, which also holds it against real logs); a
quarter of the scans there were of floors that no reference showed. Where more of a user's scans
are of unmapped places, the probability is too high, and the other way about.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import threshold


class ProbabilityConfig(eqx.Module):
    """The logistic curve."""

    offset: Float[Array, ""] = threshold(
        14.5, "logarithm of the odds at an e_m of one", least=-np.inf
    )
    slope: Float[Array, ""] = threshold(
        6.0, "what it gains for each factor of e in e_m", least=-np.inf
    )


def probability(e_m: Float[Array, "*batch"], config: ProbabilityConfig) -> Float[Array, "*batch"]:
    """Probability in [0, 1] that a hypothesis of quality `e_m`, rivals counted, is right.

    Right is within 0.5 m and 10° of the truth. Zero where `e_m` is.
    """
    positive = e_m > 0
    odds = config.offset + config.slope * jnp.log(jnp.where(positive, e_m, 1.0))
    return jnp.where(positive, jax.nn.sigmoid(odds), 0.0)
