import jax
import numpy as np
import pytest

import aprjax
from aprjax.plane import relative
from benchmarks import numpy_extraction, numpy_pipeline
from tests.worlds import office, scan_at

REFERENCE, QUERY = np.array([12.0, 0.0, 0.3]), np.array([12.4, 0.1, 0.2])


@pytest.fixture(scope="module")
def scans():
    world = office(seed=3)
    return [scan_at(world, pose) for pose in (REFERENCE, QUERY)]


def test_it_answers_as_the_library_does(scans):
    reference, query = map(numpy_extraction.describe, scans)
    pose, e_m, q_m = numpy_pipeline.match(reference, query)
    np.testing.assert_allclose(pose, relative(REFERENCE, QUERY), atol=0.03)
    ours = aprjax.match(scans[1], aprjax.ReferenceSet.build(scans[:1]))
    assert e_m == pytest.approx(float(ours.quality[0]), abs=0.15)
    assert q_m == pytest.approx(float(ours.preselection[0]), rel=0.05)


def test_most_anchors_are_the_librarys(scans):
    features = aprjax.ReferenceSet.build(scans).index.features
    for row, scan in enumerate(scans):
        anchors = jax.tree.map(lambda array: np.asarray(array)[row], features.anchors)  # noqa: B023
        points = numpy_extraction.describe(scan).graph[0]
        gap = anchors.xy[anchors.valid][:, None] - points[None]
        assert np.mean(np.hypot(*np.moveaxis(gap, -1, 0)).min(axis=1) < 0.1) >= 0.7


def test_a_scan_without_anchors_gives_no_answer(scans):
    blank = aprjax.Scan.make(np.full(90, np.nan), angle_min=0, angle_increment=0.02, range_max=9)
    nothing, something = map(numpy_extraction.describe, (blank, scans[0]))
    assert numpy_pipeline.match(something, nothing)[1:] == (0.0, 0.0)
