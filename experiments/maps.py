"""World models of the real logs: how true they are, and what half the references cost.

    python -m experiments.maps --out DIR [--stages DIR] [--timed] [--quick] [LOG ...]

For each log (see `data.py` for where) a map is built from the scans and the raw odometry, by one
set of defaults, and compared with the truth; then another whose references lie so much further
apart that there are about half as many. Writes into DIR:

- `maps.csv`: a row for each log. The figures are those of `map_scores.score_map`; rms_m is how far
  the nodes of the relaxed frame are off the truth after it was moved as a whole to where it fits
  best. Those that begin with `half_` are of the map with half the references; pair_deg_true and
  pair_deg are those of `map_scores.pair_errors`. With --timed, ms and cpu_ms are the time of
  building for each scan, compilation apart.
- `LOG.png`: the paper's Figs. 4 and 6, the relaxed frame.
- `configuration.json`: the defaults that made them.

With --stages, the scans' motion and matches, which take nearly all of the time, are kept in that
folder, and those already there are used. With --quick one small log only.
"""

import argparse
import sys
import time
from dataclasses import fields
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

import aprjax
from aprjax.atomic import atomic_write
from aprjax.configuration import to_dict
from aprjax.io.carmen import LogEntry
from aprjax.io.trajectory import read_tum
from aprjax.plot.style import figure_of
from aprjax.plot.world import draw_world
from aprjax.world.build import MapConfig, build_from_stages, build_map
from aprjax.world.model import WorldModel
from aprjax.world.motion import Motion, motion
from aprjax.world.recognition import Sightings, sightings
from aprjax.world.relax import relax
from aprjax.world.smoothing import Measurements
from experiments.data import map_folder, map_names
from experiments.map_scores import frame_rms, pair_errors, score_map
from experiments.outputs import print_table, write_configuration, write_figure, write_table

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


def figures(name: str, kept: Path | None, *, timed: bool) -> tuple[dict, WorldModel]:
    """A row of the table, and the map. `timed`: it is built once more, with nothing to compile."""
    entries, truth = read_map_log(name)
    scans = [entry.scan for entry in entries]
    described = aprjax.ReferenceSet.build(scans, MapConfig().features)
    moved, seen, seldom = stages(name, entries, described, kept)
    world = build_from_stages(scans, described, moved, seen, MapConfig())
    scores = score_map(world, truth)
    half = score_map(build_from_stages(scans, described, moved, seldom, sparse()), truth)
    row = {
        "log": name,
        "scans": len(entries),
        **{key: round(scores[key], DIGITS.get(key, 4)) for key in SHOWN},
        "rms_m": round(frame_rms(world, relax(world), truth), 3),
        "half_references": half["references"],
        "half_false_arcs": half["false_arcs"],
        "half_recognized": round(half["recognized"], 3),
        "half_arc_deg": round(half["arc_deg"], 2),
        "half_arc_deg_95": round(half["arc_deg_95"], 2),
        **{key: round(value, 2) for key, value in pair_errors(moved, truth).items()},
    }
    if timed:
        row |= _times(name, entries)
    return row, world


def stages(
    name: str, entries: list[LogEntry], described: aprjax.ReferenceSet, kept: Path | None
) -> tuple[Motion, Sightings, Sightings]:
    """The motion of a log, and its matches with all references and with half of them.

    As `build_map` has them; from the folder `kept` if they are there, else they go there.
    """
    path = None if kept is None else kept / f"{name}.npz"
    if path is not None and path.exists():
        return _read_stages(path)
    print(f"{name}: motion and matches", file=sys.stderr, flush=True)
    odometry = np.array([entry.odometry for entry in entries], float)
    moved = motion(described.index.features.view, odometry, MapConfig().motion)
    seen = sightings(described, moved, MapConfig().recognition)
    seldom = sightings(described, moved, sparse().recognition)
    if path is not None:
        _write_stages(path, moved, seen, seldom)
    return moved, seen, seldom


def _write_stages(path: Path, moved: Motion, seen: Sightings, seldom: Sightings) -> None:
    parts = {"moved": moved, "measured": moved.measured, "seen": seen, "seldom": seldom}
    arrays = {
        f"{part}.{field.name}": getattr(values, field.name)
        for part, values in parts.items()
        for field in fields(values)
        if field.name != "measured"
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path, "wb") as file:
        np.savez_compressed(file, **arrays)


def _read_stages(path: Path) -> tuple[Motion, Sightings, Sightings]:
    parts: dict[str, dict[str, np.ndarray]] = {}
    with np.load(path, allow_pickle=False) as archive:
        for name, array in archive.items():
            part, field = name.split(".")
            parts.setdefault(part, {})[field] = array
    moved = Motion(**parts["moved"], measured=Measurements(**parts["measured"]))
    return moved, Sightings(**parts["seen"]), Sightings(**parts["seldom"])


def _times(name: str, entries: list[LogEntry]) -> dict[str, float]:
    """Milliseconds of a scan by the clock, and of all cores together."""
    print(f"{name}: timing", file=sys.stderr, flush=True)
    began = time.perf_counter(), time.process_time()
    build_map(entries)
    ended = time.perf_counter(), time.process_time()
    clock, cpu = (
        1e3 * (end - start) / len(entries) for start, end in zip(began, ended, strict=True)
    )
    return {"ms": round(clock, 1), "cpu_ms": round(cpu, 1)}


def read_map_log(name: str) -> tuple[list[LogEntry], np.ndarray]:
    """A log and the true poses `(scans, 3)` of its scans."""
    folder = map_folder(name)
    _, truth = read_tum(folder / "build.tum")
    return list(aprjax.read_log(folder / "build.log.gz")), truth


def main() -> int:
    """Build, score, print, write; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("logs", nargs="*", help="names of logs (default: all)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--stages", type=Path, metavar="DIR", help="of motion and matches, kept")
    parser.add_argument("--timed", action="store_true", help="build once more and state the time")
    parser.add_argument("--quick", action="store_true", help="one small log only")
    arguments = parser.parse_args()
    names = arguments.logs or ([QUICK] if arguments.quick else map_names())
    arguments.out.mkdir(parents=True, exist_ok=True)

    rows = []
    for name in names:
        row, world = figures(name, arguments.stages, timed=arguments.timed)
        rows.append(row)
        write_figure(
            figure_of(draw_world(world, relax(world))), arguments.out / f"{name}.png", dpi=110
        )
        write_table(rows, arguments.out / "maps.csv")
        jax.clear_caches()  # the next log's scans have other shapes
    print_table(rows)
    write_configuration(arguments.out, logs=names, map=to_dict(MapConfig()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
