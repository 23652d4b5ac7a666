"""Figures as a table and as a plot."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from benchmarks.workload import Figure

_OURS, _OTHERS = "#1f5fa8", "#999999"
_WIDE = 100  # ratio of values from which an axis is logarithmic


def rows(figures: list[Figure]) -> list[dict]:
    """A row of the table for each figure."""
    return [
        {
            "workload": figure.workload,
            "metric": figure.metric,
            "unit": figure.unit,
            "direction": figure.direction,
            "value": _rounded(figure.value),
            "10%": _rounded(figure.low),
            "90%": _rounded(figure.high),
            "samples": figure.samples,
            "normalised": _rounded(figure.normalised),
            "slowness": _rounded(figure.slowness),
            "tolerance": figure.tolerance,
            "note": figure.note,
        }
        for figure in figures
    ]


def text(table: list[dict]) -> str:
    """The table with aligned columns: words to the left, numbers to the right."""
    if not table:
        return "nothing was measured\n"
    lines = []
    widths = {name: max(len(name), *(len(str(row[name])) for row in table)) for name in table[0]}
    for row in [{name: name for name in widths}, *table]:
        cells = [
            str(row[name]).ljust(width)
            if isinstance(table[0][name], str)
            else str(row[name]).rjust(width)
            for name, width in widths.items()
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines) + "\n"


def draw(figures: list[Figure], title: str) -> Drawing:
    """A panel for each unit; lines run from the 10 to the 90 % point."""
    units = list(dict.fromkeys(figure.unit for figure in figures))
    panels = [[figure for figure in figures if figure.unit == unit] for unit in units]
    sizes = [len(panel) + 1.2 for panel in panels]
    drawing = Drawing(figsize=(8, 0.32 * sum(sizes) + 0.6), layout="constrained")
    axes = drawing.subplots(len(panels), squeeze=False, height_ratios=sizes)[:, 0]
    for panel, unit, ax in zip(panels, units, axes, strict=True):
        _draw_panel(panel, unit, ax)
    drawing.suptitle(title, fontsize=9)
    return drawing


def _draw_panel(figures: list[Figure], unit: str, ax: Axes) -> None:
    position = np.arange(len(figures))
    for y, figure in zip(position, figures, strict=True):
        colour = _OTHERS if figure.workload.startswith("numpy.") else _OURS
        if figure.metric == "median":
            ax.plot([figure.low, figure.high], [y, y], color=colour, linewidth=4, alpha=0.35)
        ax.plot(figure.value, y, "o", color=colour)
        ax.annotate(
            f"{figure.value:,.0f}" if figure.value >= 100 else f"{figure.value:.3g}",
            (max(figure.value, figure.high), y),
            textcoords="offset points",
            xytext=(7, 0),
            va="center",
            fontsize=8,
        )
    low = min(figure.low for figure in figures)
    most = max(max(figure.high, figure.value) for figure in figures)
    if most > _WIDE * low > 0:
        ax.set_xscale("log")
        ax.margins(x=0.15)
    else:
        ax.set_xlim(0, 1.15 * most)
    ax.set_yticks(position, [figure.name.removesuffix(" median") for figure in figures], fontsize=8)
    ax.set_ylim(len(figures) - 0.4, -0.6)
    ax.tick_params(axis="x", labelsize=8)
    ax.set_xlabel(unit, fontsize=8)
    ax.grid(axis="x", color="#dddddd", linewidth=0.5)
    ax.set_axisbelow(True)


def _rounded(value: float) -> float:
    """To four digits."""
    return float(f"{value:.4g}")
