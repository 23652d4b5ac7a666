"""Every stage of the extraction, compiled once for the whole session."""

from typing import NamedTuple

import jax
import pytest

from aprjax.anchors.angle import angles
from aprjax.anchors.candidates import Candidates
from aprjax.anchors.extract import Anchors, ExtractionConfig, extract
from aprjax.anchors.jump_edge import jump_edges
from aprjax.anchors.segment import Segments, segment
from aprjax.anchors.surface import Surface, surface
from aprjax.anchors.virtual_edge import virtual_edges
from aprjax.scan import Scan

SLOTS = 384


class Stages(NamedTuple):
    segments: Segments
    surface: Surface
    jump_edges: Candidates
    angles: Candidates
    virtual_edges: Candidates
    anchors: Anchors


class Extraction:
    """Calls all stages on one scan, padded to `slots`; `traces` counts compilations."""

    def __init__(self):
        self.traces = 0
        self._run = jax.jit(self._stages)

    def _stages(self, scan: Scan, config: ExtractionConfig) -> Stages:
        self.traces += 1
        segments = segment(scan, config.segment)
        course = surface(segments, config.surface)
        return Stages(
            segments,
            course,
            jump_edges(segments, config.jump_edge),
            angles(segments, course, config.angle),
            virtual_edges(segments, course, config.virtual_edge),
            extract(scan, config),
        )

    def __call__(self, scan, config=None, slots=SLOTS) -> Stages:
        config = ExtractionConfig() if config is None else config
        return jax.device_get(self._run(scan.pad(slots), config))


@pytest.fixture(scope="session")
def extraction() -> Extraction:
    return Extraction()
