import jax
import numpy as np
import pytest

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import extract
from aprjax.anchors.segment import segment
from aprjax.anchors.surface import surface
from aprjax.evaluation.view import view
from aprjax.features import FeatureConfig
from aprjax.matcher import MatchConfig
from aprjax.refine import settle
from aprjax.sweeping.axes import configured
from experiments.ablations import VARIANTS, draw, table
from tests.worlds import free_pose, office, scan_at

LEFT_OUT = {
    "no jump edges": Kind.JUMP_EDGE,
    "no angles": Kind.ANGLE,
    "no virtual edges": Kind.VIRTUAL_EDGE,
}
anchors_of = jax.jit(extract)


@pytest.fixture(scope="module")
def scans():
    world, rng = office(seed=3), np.random.default_rng(0)
    return [scan_at(world, free_pose(world, rng)) for _ in range(6)]


def kinds(scans, variant):
    """All that the scans have."""
    config = configured(FeatureConfig(), VARIANTS[variant].features)
    found = [anchors_of(scan, config.extraction) for scan in scans]
    return {int(kind) for a in found for kind in np.asarray(a.kind)[np.asarray(a.valid)]}


@pytest.mark.parametrize("variant", LEFT_OUT)
def test_a_kind_of_anchor_is_left_out_and_the_others_stay(scans, variant):
    assert kinds(scans, "defaults") == set(Kind)
    assert kinds(scans, variant) == set(Kind) - {LEFT_OUT[variant]}


def test_every_variant_makes_a_configuration_and_those_without_the_cascade_need_a_program():
    for variant in VARIANTS.values():
        configured(MatchConfig(cascade=variant.cascade), variant.match)
        configured(FeatureConfig(), variant.features)
    without = [name for name, variant in VARIANTS.items() if not variant.cascade]
    assert without == ["no cascade", "no cascade, no angle histogram"]


def test_without_refinement_poses_stay_where_edges_put_them(scans):
    config = configured(MatchConfig(), VARIANTS["no refinement"].match)
    features = FeatureConfig()

    @jax.jit
    def settled(scan, config):
        segments = segment(scan, features.extraction.segment)
        course = surface(segments, features.extraction.surface)
        seen = view(scan, segments, course, features.view)
        return settle(seen, seen, np.array([0.1, 0.05, 0.02], np.float32), config)

    np.testing.assert_allclose(settled(scans[0], config.refine), [0.1, 0.05, 0.02], atol=1e-6)
    assert np.abs(settled(scans[0], MatchConfig().refine)).max() < 0.02


def test_the_table_has_means_and_what_each_variant_costs():
    def figures(hits):
        return {"top1": 1.0, "hits": hits, "confident_right": 0.5, "confident_wrong": 1}

    rows = table(
        {
            "defaults": {"a": figures(0.8), "b": figures(0.6)},
            "no angles": {"a": figures(0.7), "b": figures(0.6)},
        }
    )
    assert [(row["variant"], row["split"]) for row in rows] == [
        (variant, split) for variant in ("defaults", "no angles") for split in ("a", "b", "mean")
    ]
    assert [row["hits"] for row in rows] == [0.8, 0.6, 0.7, 0.7, 0.6, 0.65]
    assert [row["change"] for row in rows] == [0, 0, 0, -0.1, 0, -0.05]
    labels = [label.get_text() for label in draw(rows).axes[0].get_yticklabels()]
    assert labels == ["defaults", "no angles"]
