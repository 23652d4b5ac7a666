"""What is known of a scan before it is compared with any other."""

import equinox as eqx
from jaxtyping import Array, Float

from aprjax.anchors.extract import Anchors, ExtractionConfig, choose_anchors
from aprjax.anchors.segment import segment
from aprjax.anchors.surface import surface
from aprjax.evaluation.raster import Raster, RasterConfig, raster
from aprjax.evaluation.screen import Sketch, SketchConfig, sketch
from aprjax.evaluation.signature import discriminant, signature
from aprjax.evaluation.view import View, ViewConfig, view
from aprjax.relations.graph import AnchorGraph, anchor_graph
from aprjax.relations.histograms import EdgeHistogram, RelationConfig, edge_histogram
from aprjax.scan import Scan


class FeatureConfig(eqx.Module):
    """How scans are described. References and queries must be described alike."""

    extraction: ExtractionConfig = ExtractionConfig()
    relation: RelationConfig = RelationConfig()
    view: ViewConfig = ViewConfig()
    raster: RasterConfig = RasterConfig()
    sketch: SketchConfig = SketchConfig()


class Features(eqx.Module):
    """One scan's anchors, their graph, its edges by length, its surfaces, and their look."""

    anchors: Anchors
    graph: AnchorGraph
    histogram: EdgeHistogram
    view: View
    raster: Raster
    sketch: Sketch
    signature: Float[Array, "*batch size"]


def seen(scan: Scan, config: FeatureConfig) -> View:
    """The surfaces of one scan, all that is needed where no anchors are."""
    segments = segment(scan, config.extraction.segment)
    return view(scan, segments, surface(segments, config.extraction.surface), config.view)


def describe(scan: Scan, config: FeatureConfig) -> Features:
    """The features of one scan. Any scan has some; a bad one has no anchors."""
    segments = segment(scan, config.extraction.segment)
    course = surface(segments, config.extraction.surface)
    anchors = choose_anchors(segments, course, config.extraction)
    graph = anchor_graph(anchors)
    surfaces = view(scan, segments, course, config.view)
    return Features(
        anchors=anchors,
        graph=graph,
        histogram=edge_histogram(graph, config.relation),
        view=surfaces,
        raster=raster(surfaces, config.raster),
        sketch=sketch(surfaces, config.sketch),
        signature=signature(surfaces, discriminant()),
    )
