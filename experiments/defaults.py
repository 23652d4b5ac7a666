"""What each default is worth: every threshold and capacity halved and doubled.

    python -m experiments.defaults --out DIR [--quick] [--stride N] [--only SETTING ...]

Walks `FeatureConfig` and `MatchConfig`; all else keeps its default. Four splits of real logs (see
`data.py` for where) are matched with all references, every fourth query of them. One row for each
setting: the means over the splits of top1, hits and the median error of right answers, as in
`real_logs.py`, and the effect, the largest change of top1 or hits either way. Prints the rows by
effect, and the settings that are left out with the reason; writes `defaults.csv`, row by row,
`configuration.json`, and `defaults.png`, the settings of the greatest effect, into DIR.

Thresholds compile nothing; a capacity compiles anew for each value and split. With --quick
capacities are left out. --only measures the settings named, with all below them.
"""

import argparse
import copy
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.configuration import from_dict, to_dict
from aprjax.metrics import score_matches
from experiments.data import FOUR, Split, read_split
from experiments.outputs import (
    DARK,
    grouped_bars,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

FACTORS = {"halved": 0.5, "doubled": 2.0}
FIGURES = ("top1", "hits", "error_m")
DRAWN = 16  # settings

_Q_M = "for q_m, by which nothing is chosen where all references are aligned"
REASONS = {
    "features.relation.parts": _Q_M,
    "features.relation.part_tolerance": _Q_M,
    "match.distinctiveness.equal": "calls answers ambiguous, and ranks none",
    "match.confident": "calls answers confident, and ranks none",
    "match.probability.offset": "probability follows the order of e_m",
    "match.probability.slope": "probability follows the order of e_m",
    "match.hypotheses": "how many are reported",
    "match.chunk": "bounds the memory",
}
"""Why a setting is left out, but for those that are no numbers, or zero."""


@dataclass(frozen=True)
class Setting:
    """A threshold or a capacity, and its default."""

    path: tuple[str, ...]
    default: float | int | bool | None

    @property
    def name(self) -> str:
        """The path with dots."""
        return ".".join(self.path)

    def is_below(self, name: str) -> bool:
        """Whether `name` is its own, or that of a configuration it is part of."""
        return f"{self.name}.".startswith(f"{name}.")

    @property
    def capacity(self) -> bool:
        """Whether it sets the size of an array."""
        return not isinstance(self.default, float)

    @property
    def reason(self) -> str | None:
        """Why halving and doubling it says nothing; None where it does."""
        if self.default is None or isinstance(self.default, bool):
            return "no number"
        return "zero" if self.default == 0 else REASONS.get(self.name)

    def scaled(self, config: dict[str, Any], factor: float) -> dict[str, Any]:
        """The configuration with `factor` times the default; capacities are rounded down."""
        if self.default is None:
            raise ValueError(f"{self.name}: not a number")
        config = copy.deepcopy(config)
        *above, last = self.path
        part = config
        for name in above:
            part = part[name]
        part[last] = type(self.default)(factor * self.default)
        return config


def settings(config: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[Setting]:
    """All of a configuration, in the order of its fields."""
    for name, value in config.items():
        if isinstance(value, dict):
            yield from settings(value, (*path, name))
        else:
            yield Setting((*path, name), value)


def measured(config: dict[str, Any], splits: list[Split]) -> dict[str, float]:
    """The figures of a configuration: means over the splits."""
    features = from_dict(aprjax.FeatureConfig, config["features"])
    match = from_dict(aprjax.MatchConfig, config["match"])
    scores = []
    for split in splits:
        references = aprjax.ReferenceSet.build(split.references, features)
        result = aprjax.match_batch(split.queries, references, match)
        truth = (split.T_world_ref, split.T_world_query)
        scores.append(score_matches(result, references.ids, *truth, split.mapped))
    return {name: float(np.mean([getattr(each, name) for each in scores])) for name in FIGURES}


def row(name: str, default: Any, found: dict[str, dict[str, float]], base: dict) -> dict:
    """A row of the table, of what was found when halved and when doubled."""
    changes = [
        abs(each[figure] - base[figure]) for each in found.values() for figure in FIGURES[:2]
    ]
    return {
        "setting": name,
        "default": default,
        **{
            f"{figure}_{label}": round(each[figure], 4)
            for figure in FIGURES
            for label, each in found.items()
        },
        "effect": round(max(changes), 4),
    }


def draw(rows: list[dict]) -> Figure:
    """How far the settings of the greatest effect move top1 and hits."""
    base, *others = rows
    others = others[:DRAWN]
    names = [f"{row['setting']} ({row['default']})" for row in others]
    figure = Figure(figsize=(11, 0.36 * len(others) + 1.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for ax, of in zip(panels, FIGURES[:2], strict=True):
        start = float(base[f"{of}_halved"])
        found = {label: [float(row[f"{of}_{label}"]) for row in others] for label in FACTORS}
        grouped_bars(ax, names, found, start)
        ax.axvline(start, color=DARK, lw=0.8)
        ax.set_xlabel(f"{of} (defaults: {start:.3f})")
        ax.grid(axis="x", color="#dddddd", linewidth=0.5)
        ax.set_axisbelow(True)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def main() -> int:
    """Measure, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="thresholds only")
    parser.add_argument("--stride", type=int, default=4, metavar="N", help="every N-th query")
    parser.add_argument("--only", nargs="+", default=[], metavar="SETTING", help="these alone")
    arguments = parser.parse_args()
    if arguments.stride < 1:
        parser.error(f"--stride: {arguments.stride} is not a positive number")
    config = {"features": to_dict(aprjax.FeatureConfig()), "match": to_dict(aprjax.MatchConfig())}
    everything = list(settings(config))
    varied = [setting for setting in everything if setting.reason is None]
    for name in arguments.only:
        if not any(setting.is_below(name) for setting in varied):
            parser.error(f"--only: no setting that is varied has the name {name}")
    if arguments.only:
        varied = [s for s in varied if any(s.is_below(name) for name in arguments.only)]
    if arguments.quick:
        varied = [setting for setting in varied if not setting.capacity]
    splits = [read_split(name, arguments.stride) for name in FOUR]
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_configuration(arguments.out, splits=FOUR, every=arguments.stride)
    # Thresholds first: they share what is compiled for the defaults.
    varied.sort(key=lambda setting: setting.capacity)

    base = measured(config, splits)
    rows = [row("(defaults)", "", dict.fromkeys(FACTORS, base), base)]
    for number, setting in enumerate(varied, 1):
        found = {}
        for label, factor in FACTORS.items():
            found[label] = measured(setting.scaled(config, factor), splits)
            if setting.capacity:
                jax.clear_caches()
        rows.append(row(setting.name, round(setting.default or 0, 6), found, base))
        rows[1:] = sorted(rows[1:], key=lambda each: -each["effect"])
        write_table(rows, arguments.out / "defaults.csv")
        print(f"{number} of {len(varied)}: {setting.name}", file=sys.stderr, flush=True)

    print_table(rows)
    write_figure(draw(rows), arguments.out / "defaults.png")
    print("left out:")
    for setting in everything:
        if setting.reason is not None:
            print(f"  {setting.name}: {setting.reason}")
    if arguments.quick:
        print("  all capacities: --quick")
    return 0


if __name__ == "__main__":
    sys.exit(main())
