"""The alignment of two graphs, compiled once for the whole session."""

import jax
import pytest

from aprjax.alignment.align import AlignmentConfig, align
from aprjax.relations.histograms import RelationConfig, direction_spectrum, matching_angles


class Alignment:
    """Calls `align` on graphs with their matching angles; `traces` counts compilations."""

    def __init__(self):
        self.traces = 0
        self._run = jax.jit(self._align)
        self._histogram = jax.jit(self._matching_angles)

    def _matching_angles(self, reference, query):
        config = RelationConfig()
        queries, references = (
            direction_spectrum(graph, config)[None] for graph in (query, reference)
        )
        return matching_angles(queries, references, config)[0, 0]

    def _align(self, reference, query, histogram, config):
        self.traces += 1
        return align(reference, query, histogram, config)

    def histogram(self, reference, query):
        return jax.device_get(self._histogram(reference, query))

    def __call__(self, reference, query, config=None):
        config = AlignmentConfig() if config is None else config
        histogram = self._histogram(reference, query)
        return jax.device_get(self._run(reference, query, histogram, config))


@pytest.fixture(scope="session")
def alignment() -> Alignment:
    return Alignment()
