import numpy as np
import pytest

from aprjax.metrics import Answers
from aprjax.plot.sweep import QualityCurve, draw_quality_curves, draw_sweep


def answers():
    """Four mapped queries and one that is not; equal qualities at 0.5."""
    return Answers(
        quality=np.array([0.9, 0.5, 0.5, 0.2, 0.7]),
        right=np.array([True, True, False, True, False]),
        wrong=np.array([False, False, True, False, False]),
        mapped=np.array([True, True, True, True, False]),
    )


def test_the_curve_has_one_point_for_each_threshold_that_tells_answers_apart():
    curve = QualityCurve.of(answers())
    np.testing.assert_allclose(curve.quality, [0.9, 0.5, 0.2])
    np.testing.assert_allclose(curve.recall, [1 / 4, 2 / 4, 3 / 4])
    np.testing.assert_allclose(curve.precision, [1, 2 / 3, 3 / 4])
    np.testing.assert_allclose(curve.false_rate, [0, 1, 1])


def test_the_curves_hold_the_hits_that_a_share_of_wrong_answers_allows():
    curve = QualityCurve.of(answers())
    fits = curve.precision >= 1 - 0.25
    assert answers().accepted(0.25) == curve.recall[fits].max()


def test_one_axis_is_drawn_as_curves_through_the_values():
    figure = draw_sweep({"a": np.array([1.0, 2.0])}, {"hits": np.array([0.3, 0.4])}, "hits")
    (line,) = figure.axes[0].lines
    np.testing.assert_allclose(line.get_xydata(), [[1, 0.3], [2, 0.4]])
    assert figure.axes[0].get_xlabel() == "a"


def test_a_third_axis_stands_where_the_share_is_best():
    axes = {name: np.arange(2.0) for name in "abc"}
    hits = np.arange(8.0).reshape(2, 2, 2) / 10
    hits[0, 0] = [0.9, 0.1]
    top1 = np.where(hits == 0.9, 1.0, hits)
    figure = draw_sweep(axes, {"hits": hits, "top1": top1}, "hits")
    shown = [ax.images[0].get_array().T.tolist() for ax in figure.axes if ax.images]
    assert shown == [[[0.9, 0.3], [0.5, 0.7]], [[1.0, 0.3], [0.5, 0.7]]]


def test_a_sweep_without_an_axis_is_refused():
    with pytest.raises(ValueError, match="axes"):
        draw_sweep({}, {"hits": np.zeros(())}, "hits")


def test_few_curves_are_all_named_and_many_by_the_first_and_the_last():
    def named(count):
        figure = draw_quality_curves(
            [QualityCurve.of(answers())] * count, list(map(str, range(count)))
        )
        return [text.get_text() for text in figure.legends[0].get_texts()]

    assert named(3) == ["0", "1", "2"]
    assert named(20) == ["0", "19"]
