"""Every threshold at the ends of its range: whatever is found then, it is numbers."""

import dataclasses
from collections.abc import Iterator

import equinox as eqx
import jax
import numpy as np
import pytest

from aprjax.batch import match
from aprjax.features import FeatureConfig
from aprjax.matcher import MatchConfig
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.sweeping.axes import configured
from tests.worlds import free_pose, office, scan_at


def ends(config: eqx.Module, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Each threshold by its dotted name, with either end of its range that there is."""
    for field in dataclasses.fields(config):
        value, name = getattr(config, field.name), prefix + field.name
        if isinstance(value, eqx.Module):
            yield from ends(value, f"{name}.")
        elif "least" in field.metadata:
            range_ = field.metadata["least"], field.metadata["most"]
            yield from ((name, end) for end in range_ if np.isfinite(end))


def matched(queries, references, config=None):
    """One query after the other: what other tests compile."""
    single = [match(query, references, config) for query in queries]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *single)


def assert_numbers(result, of):
    for path, leaf in jax.tree_util.tree_leaves_with_path(result):
        assert np.isfinite(leaf).all(), (of, jax.tree_util.keystr(path))


@pytest.fixture(scope="module")
def scans():
    """References, and queries near them, elsewhere, and of nothing."""
    world, rng = office(seed=3), np.random.default_rng(2)
    poses = [free_pose(world, rng) for _ in range(3)]
    near = [pose + np.array([0.2, 0.1, 0.3]) for pose in poses[:2]]
    blank = Scan.make(np.full(181, np.nan), angle_min=-1.5, angle_increment=0.01, range_max=9.0)
    elsewhere = [scan_at(office(seed=8), free_pose(world, rng)) for _ in range(3)]
    queries = [*(scan_at(world, pose, noise=0.01, rng=rng) for pose in near), *elsewhere, blank]
    return [scan_at(world, pose) for pose in poses], queries


def test_of_the_matcher(scans):
    references, queries = ReferenceSet.build(scans[0]), scans[1]
    found = list(ends(MatchConfig()))
    assert ("congruence.quality.anchors", 0.0) in found
    assert ("shortlist.angle", np.pi) in found
    for name, end in found:
        result = matched(queries, references, configured(MatchConfig(), {name: end}))
        assert_numbers(result, (name, end))
    nothing_asked = configured(
        MatchConfig(),
        {
            "congruence.quality.anchors": 0,
            "congruence.quality.extent": 0,
            "alignment.min_anchors": 0,
        },
    )
    result = matched(queries, references, nothing_asked)
    assert_numbers(result, "nothing asked of what agrees")
    assert result.valid[:2, 0].all()


def test_of_the_description_of_scans(scans):
    known, queries = scans
    for name, end in ends(FeatureConfig()):
        references = ReferenceSet.build(known, configured(FeatureConfig(), {name: end}))
        assert_numbers(references.index.features, (name, end))
        assert_numbers(matched(queries, references), (name, end))
