"""Anchor points of a scan: the three kinds together (paper 2.A)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.anchors.angle import AngleConfig, angles
from aprjax.anchors.candidates import Candidates
from aprjax.anchors.jump_edge import JumpEdgeConfig, jump_edges
from aprjax.anchors.segment import SegmentConfig, Segments, segment
from aprjax.anchors.surface import Surface, SurfaceConfig, surface
from aprjax.anchors.virtual_edge import VirtualEdgeConfig, virtual_edges
from aprjax.configuration import capacity, threshold
from aprjax.scan import Scan


class ExtractionConfig(eqx.Module):
    """Everything that decides which anchors a scan has."""

    segment: SegmentConfig = SegmentConfig()
    surface: SurfaceConfig = SurfaceConfig()
    jump_edge: JumpEdgeConfig = JumpEdgeConfig()
    angle: AngleConfig = AngleConfig()
    virtual_edge: VirtualEdgeConfig = VirtualEdgeConfig()
    apart: Float[Array, ""] = threshold(0.25, "metres between two anchors")
    anchors: int = capacity(16, "most anchors of a scan")

    def __check_init__(self) -> None:
        # Graphs are dense, and counts of correspondences share 32 bits with where they are.
        if not 2 <= self.anchors <= 128:
            raise ValueError(f"anchors: {self.anchors} is not from 2 to 128")


class Anchors(eqx.Module):
    """The anchor points of one scan, most salient first, padded to a fixed capacity."""

    xy: Float[Array, "*batch anchors 2"]
    """Metres in the laser's frame; zero where not valid."""
    kind: Int[Array, "*batch anchors"]
    """A `Kind`; zero where not valid."""
    salience: Float[Array, "*batch anchors"]
    """Larger is better; zero where not valid."""
    valid: Bool[Array, "*batch anchors"]
    overflow: Int[Array, "*batch"]
    """Distinct candidates that did not fit, counted up to the capacity."""


def extract(scan: Scan, config: ExtractionConfig) -> Anchors:
    """The anchors of one scan. Empty and invalid scans have none."""
    segments = segment(scan, config.segment)
    return choose_anchors(segments, surface(segments, config.surface), config)


def choose_anchors(segments: Segments, course: Surface, config: ExtractionConfig) -> Anchors:
    """The anchors of one segmented scan whose surfaces are known."""
    candidates = Candidates.join(
        jump_edges(segments, config.jump_edge),
        angles(segments, course, config.angle),
        virtual_edges(segments, course, config.virtual_edge),
    )
    best, overflow = candidates.best(config.anchors, config.apart)
    return Anchors(
        xy=jnp.where(best.valid[:, None], best.xy, 0.0),
        kind=jnp.where(best.valid, best.kind, 0),
        salience=jnp.where(best.valid, best.salience, 0.0),
        valid=best.valid,
        overflow=overflow,
    )
