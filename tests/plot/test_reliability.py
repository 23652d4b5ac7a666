import numpy as np
import pytest
from matplotlib.figure import Figure

from aprjax.plot.reliability import draw_reliability
from aprjax.plot.style import figure_of


def test_each_filled_bin_is_a_dot_at_its_claim_and_its_share():
    claimed = np.array([0.02, 0.04, 0.55, 0.98, 0.96])
    right = np.array([False, False, True, True, False])
    figure = figure_of(draw_reliability(claimed, right, "lab"))
    (ax,) = figure.axes
    dots = np.asarray(ax.collections[0].get_offsets())
    np.testing.assert_allclose(dots, [(0.03, 0.0), (0.55, 1.0), (0.97, 0.5)])
    assert [text.get_text() for text in ax.texts] == ["2", "1", "2"]
    assert ax.get_title().startswith("lab  error 0.")


@pytest.mark.parametrize("count", [0, 1])
def test_it_is_drawn_on_given_axes_and_without_hypotheses(count):
    ax = Figure().add_subplot()
    drawn = draw_reliability(np.full(count, 0.5), np.ones(count, bool), ax=ax)
    assert all(artist.axes is ax for artist in drawn)
