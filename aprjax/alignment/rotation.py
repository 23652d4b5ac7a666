"""Likely rotations between two scans: the peaks of the matching angle histogram (paper 2.C)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import capacity


class RotationConfig(eqx.Module):
    """How many rotations are followed up."""

    peaks: int = capacity(2, "peaks of the histogram; each stands for two rotations")
    width: int = capacity(1, "bins to each side that belong to a peak", least=0)


class Rotations(eqx.Module):
    """Rotations of the query in the reference's frame, most votes first."""

    angle: Float[Array, " rotations"]
    """Radians."""
    votes: Float[Array, " rotations"]
    """Corresponding edges that indicate it; zero where there was no further peak."""


def rotation_peaks(histogram: Float[Array, " direction_bins"], config: RotationConfig) -> Rotations:
    """The `2 * peaks` rotations at the peaks of one matching angle histogram.

    A peak's rotation is the mean over its bins. Undirected edges give it modulo half a turn, so
    each peak yields two; which of them holds is for the correspondence matrix to decide.
    """
    bins = histogram.shape[-1]
    offsets = np.arange(-config.width, config.width + 1)
    shifted = jnp.stack([jnp.roll(histogram, -shift) for shift in offsets])
    votes = jnp.sum(shifted, axis=0)
    tilt = jnp.sum(offsets[:, None].astype(np.float32) * shifted, axis=0)
    position = jnp.arange(bins)

    def choose(left, _):
        peak = jnp.argmax(left)
        distance = jnp.abs(position - peak)
        near = jnp.minimum(distance, bins - distance) <= 2 * config.width
        return jnp.where(near, 0.0, left), (peak, left[peak])

    _, (peak, height) = jax.lax.scan(choose, votes, length=config.peaks)
    mean = peak.astype(jnp.float32) + tilt[peak] / jnp.maximum(votes[peak], 1.0)
    angle = mean * (np.pi / bins)
    return Rotations(
        angle=jnp.concatenate([angle, angle + np.pi]), votes=jnp.concatenate([height, height])
    )
