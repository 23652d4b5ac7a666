"""World models of the real logs: how true they are, and what half the references cost.

    python experiments/maps.py --out DIR [--quick] [LOG ...]

For each log (see `data.py` for where) a map is built from the scans and the raw odometry, by one
set of defaults, and compared with the truth; then another whose references lie so much further
apart that there are about half as many. Writes into DIR:

- `maps.csv`: a row for each log. The figures are those of `map_scores.score_map`; rms_m is how far
  the nodes of the relaxed frame are off the truth after it was moved as a whole to where it fits
  best; ms is the time of building for each scan, compilation apart. `half_references`,
  `half_false_arcs` and `half_recognized` are of the map with half the references.
- `LOG.png`: the paper's Figs. 4 and 6, the relaxed frame.
- `configuration.json`: the defaults that made them.

With --quick one small log only, and its time with compilation.
"""

import argparse
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
from data import map_folder, map_names
from map_scores import frame_rms, score_map
from outputs import print_table, write_configuration, write_figure, write_table

import aprjax
from aprjax.configuration import to_dict
from aprjax.io.carmen import LogEntry
from aprjax.io.trajectory import read_tum
from aprjax.plot.style import figure_of
from aprjax.plot.world import draw_world
from aprjax.world.build import MapConfig, build_map
from aprjax.world.model import WorldModel
from aprjax.world.relax import relax

QUICK = "belgioioso"
SHOWN = (
    *("nodes", "references", "arcs", "closed", "false_arcs", "recognized"),
    *("arc_m", "arc_m_95", "arc_deg", "arc_deg_95", "false_places", "place_m_95"),
)
DIGITS = {"recognized": 3, "arc_deg": 2, "arc_deg_95": 2, "place_m_95": 1}
"""Of the figures; others have four."""


def sparse() -> MapConfig:
    """The defaults but for references twice as far apart, which leaves about half of them."""
    config = MapConfig()
    apart = 2 * config.gap, 2 * config.turn, 2 * config.recognition.gap, 2 * config.recognition.turn
    return eqx.tree_at(
        lambda c: (c.gap, c.turn, c.recognition.gap, c.recognition.turn), config, apart
    )


def figures(name: str, *, timed: bool) -> tuple[dict, WorldModel]:
    """A row of the table, and the map. `timed`: it is built once before, which compiles."""
    entries, truth = read_map_log(name)
    if timed:
        _build(name, entries, MapConfig())
    began = time.perf_counter()
    world = _build(name, entries, MapConfig())
    seconds = time.perf_counter() - began
    scores = score_map(world, truth)
    half = score_map(_build(name, entries, sparse()), truth)
    row = {
        "log": name,
        "scans": len(entries),
        **{key: round(scores[key], DIGITS.get(key, 4)) for key in SHOWN},
        "rms_m": round(frame_rms(world, relax(world), truth), 3),
        "ms": round(1e3 * seconds / len(entries), 1),
        "half_references": half["references"],
        "half_false_arcs": half["false_arcs"],
        "half_recognized": round(half["recognized"], 3),
    }
    return row, world


def read_map_log(name: str) -> tuple[list[LogEntry], np.ndarray]:
    """A log and the true poses `(scans, 3)` of its scans."""
    folder = map_folder(name)
    _, truth = read_tum(folder / "build.tum")
    return list(aprjax.read_log(folder / "build.log.gz")), truth


def _build(name: str, entries: list[LogEntry], config: MapConfig) -> WorldModel:
    print(f"{name}: building, references {float(config.gap)} m apart", file=sys.stderr, flush=True)
    return build_map(entries, config)


def main() -> int:
    """Build, score, print, write; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("logs", nargs="*", help="names of logs (default: all)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="one small log only")
    arguments = parser.parse_args()
    names = arguments.logs or ([QUICK] if arguments.quick else map_names())
    arguments.out.mkdir(parents=True, exist_ok=True)

    rows = []
    for name in names:
        row, world = figures(name, timed=not arguments.quick)
        rows.append(row)
        write_figure(
            figure_of(draw_world(world, relax(world))), arguments.out / f"{name}.png", dpi=130
        )
        write_table(rows, arguments.out / "maps.csv")
        jax.clear_caches()  # the next log's scans have other shapes
    print_table(rows)
    write_configuration(arguments.out, logs=names, map=to_dict(MapConfig()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
