import numpy as np
import pytest

from aprjax.scan import Scan
from experiments.scaling import draw, slope, some
from tests.worlds import office, scan_at


def test_the_slope_of_a_power_law_is_its_exponent():
    assert slope([15, 30, 60], [3 * 15**1.5, 3 * 30**1.5, 3 * 60**1.5]) == pytest.approx(1.5)
    assert slope([15, 30, 60], [2.0, 2.0, 2.0]) == pytest.approx(0, abs=1e-9)


def test_thinned_scans_keep_the_bearings_of_the_beams_that_stay():
    world = office(seed=3)
    scans = Scan.stack([scan_at(world, np.array([12.0, 0.0, 0.1 * k])) for k in range(3)])
    thin = some(scans, 2, every=2)
    assert thin.beams.tolist() == [91, 91]
    bearings = np.asarray(scans.bearings)[:2, ::2]
    np.testing.assert_allclose(np.asarray(thin.bearings)[:, :91], bearings[:, :91], atol=1e-5)
    np.testing.assert_array_equal(thin.ranges, np.asarray(scans.ranges)[:2, ::2])


def test_every_stage_is_drawn_with_its_slope():
    rows = [
        {"varies": "references", "value": value, "stage": stage, "ms": value * scale}
        for stage, scale in (("voting", 1.0), ("all of them", 2.0))
        for value in (15, 30)
    ]
    slopes = [{"varies": "references", "stage": s, "slope": 1.0} for s in ("voting", "all of them")]
    (ax,) = draw(rows, slopes).axes
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["voting: 1.00", "all of them: 1.00"]
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
