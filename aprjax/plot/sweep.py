"""Sweeps as pictures: figures over one axis or two, and curves over the quality threshold."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aprjax.metrics import Answers
from aprjax.plot.style import add_legend

_COLOURS = ("#1f5fa8", "#2a8a3e", "#c1272d", "#8a5a00")
_MAP = "viridis"
_NAMED = 6  # curves that a legend still names one by one
_WRITTEN = 150  # cells of a heat map whose numbers are still readable


@dataclass(frozen=True, eq=False)
class QualityCurve:
    """What each threshold on e_m accepts, the strictest first: `(thresholds,)` each."""

    quality: np.ndarray
    """The threshold."""
    recall: np.ndarray
    """Right accepted answers, of all mapped queries."""
    precision: np.ndarray
    """Right ones among the accepted."""
    false_rate: np.ndarray
    """Wrong accepted answers, of all wrong ones; zero where there are none."""

    @classmethod
    def of(cls, answers: Answers) -> "QualityCurve":
        """That of the best hypotheses of queries."""
        counts = answers.right | answers.wrong
        order = np.argsort(-answers.quality[counts], kind="stable")
        quality = answers.quality[counts][order]
        right, wrong = (np.cumsum(mask[counts][order]) for mask in (answers.right, answers.wrong))
        last = np.diff(quality, append=-np.inf) != 0  # a threshold takes equal qualities together
        quality, right, wrong = quality[last], right[last], wrong[last]
        return cls(
            quality=quality,
            recall=right / max(int(answers.mapped.sum()), 1),
            precision=right / np.maximum(right + wrong, 1),
            false_rate=wrong / max(int(answers.wrong.sum()), 1),
        )


def draw_sweep(
    axes: Mapping[str, np.ndarray], shares: Mapping[str, np.ndarray], best_of: str
) -> Figure:
    """Draw shares in [0, 1] over one axis as curves, over two as heat maps.

    `axes` are the values of each threshold, and each of `shares` has one axis for each of them. Of
    more than two the first two are drawn, with all others where the share called `best_of` is
    best. Raises `ValueError` for no axis.
    """
    if not axes:
        raise ValueError("axes: there is none")
    names, values = list(axes), [np.asarray(value) for value in axes.values()]
    if len(names) == 1:
        figure = Figure(figsize=(6.4, 4.4), layout="constrained")
        _draw_curves(figure.add_subplot(), values[0], shares)
        figure.axes[0].set_xlabel(names[0])
        return figure
    shape = shares[best_of].shape[:2]
    best = np.nan_to_num(shares[best_of].reshape(*shape, -1), nan=-1).argmax(axis=2)[..., None]
    figure = Figure(figsize=(6.0 * len(shares), 4.8), layout="constrained")
    panels = figure.subplots(1, len(shares), squeeze=False)[0]
    for ax, (name, share) in zip(panels, shares.items(), strict=True):
        cells = np.take_along_axis(share.reshape(*shape, -1), best, axis=2)[..., 0]
        _draw_cells(figure, ax, values[:2], cells)
        others = f", others where {best_of} is best" if len(names) > 2 else ""
        ax.set(xlabel=names[0], ylabel=names[1], title=f"{name}{others}")
    return figure


def draw_quality_curves(curves: Sequence[QualityCurve], labels: Sequence[str]) -> Figure:
    """Draw recall over the rate of false answers, and precision over recall, one curve each.

    A few curves are named; of many, the colour runs from the first to the last.
    """
    figure = Figure(figsize=(10.8, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    colours = matplotlib.colormaps[_MAP](np.linspace(0, 0.9, len(curves)))
    for k, (curve, label) in enumerate(zip(curves, labels, strict=True)):
        shown = label if len(curves) <= _NAMED or k in (0, len(curves) - 1) else None
        style = {"color": colours[k], "linewidth": 1.2, "label": shown}
        left.step(np.r_[0, curve.false_rate], np.r_[0, curve.recall], where="post", **style)
        right.plot(curve.recall, curve.precision, **style)
    left.set(xlabel="share of the wrong answers accepted", ylabel="recall")
    right.set(xlabel="recall: share of the mapped queries", ylabel="precision")
    for ax in (left, right):
        ax.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
        ax.grid(color="#dddddd", linewidth=0.5)
    figure.legend(
        *left.get_legend_handles_labels(), loc="outside lower center", frameon=False, fontsize=8
    )
    return figure


def _draw_curves(ax: Axes, values: np.ndarray, shares: Mapping[str, np.ndarray]) -> None:
    for colour, (name, share) in zip(_COLOURS, shares.items(), strict=False):
        ax.plot(values, share, color=colour, marker="o", markersize=3.5, label=name)
    ax.set_ylim(-0.03, 1.03)
    ax.set_ylabel("share")
    ax.grid(color="#dddddd", linewidth=0.5)
    ax.set_axisbelow(True)
    add_legend(ax)


def _draw_cells(figure: Figure, ax: Axes, values: Sequence[np.ndarray], cells: np.ndarray) -> None:
    """One cell for each pair of values, evenly spaced; a few of them with their number."""
    image = ax.imshow(cells.T, origin="lower", aspect="auto", cmap=_MAP)
    figure.colorbar(image, ax=ax)
    for set_ticks, along in zip((ax.set_xticks, ax.set_yticks), values, strict=True):
        shown = np.unique(np.linspace(0, len(along) - 1, min(len(along), 8)).round().astype(int))
        set_ticks(shown, [f"{value:.3g}" for value in along[shown]])
    if cells.size > _WRITTEN:
        return
    low, high = np.nanmin(cells), np.nanmax(cells)
    for (x, y), value in np.ndenumerate(cells):
        dark = value < low + 0.6 * (high - low)
        colour = "white" if dark else "black"
        ax.text(x, y, f"{value:.3f}", ha="center", va="center", fontsize=7, color=colour)
