"""All experiments, one after another: `python -m experiments --out DIR [--quick] [NAME ...]`.

Each runs in a process of its own, and writes what it makes and what it prints (`output.txt`) into
DIR/NAME. `--list` names them. Experiments with real logs need the folder of the data, see
`data.py`; one that fails is named at the end, and the others run all the same. DIR/manifest.json
says what was run, and how; DIR/times.csv how long it took.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from aprjax.atomic import atomic_write

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Experiment:
    """A command, and what it is told."""

    what: str
    quick: tuple[str, ...] = ("--quick",)
    command: tuple[str, ...] | None = None
    """The first words after the interpreter; None runs the module here of the experiment's name."""

    def words(self, name: str, out: Path, quick: bool) -> list[str]:
        """All words after the interpreter."""
        command = self.command or ("-m", f"experiments.{name}")
        return [*command, "--out", str(out), *(self.quick if quick else ())]


FEW = "features.extraction.surface", "match.alignment.min_anchors"

EXPERIMENTS = {
    "worked_example": Experiment("Fig. 2 of the paper"),
    "anchors": Experiment("Fig. 1, and how repeatable anchors are"),
    "lab": Experiment(
        "Fig. 3 and the numbers of 2.E in a simulated lab",
        ("--scans", "140"),
        ("-m", "aprjax.cli.main", "demo"),
    ),
    "real_logs": Experiment("the same on real logs"),
    "preselection": Experiment("which references come first (2.B)"),
    "signature": Experiment("what tells places apart, for signatures"),
    "million": Experiment("the same for up to a million references, and what a query costs"),
    "ablations": Experiment("what each part is worth"),
    "scaling": Experiment("time over references, anchors and beams"),
    "all_against_all": Experiment("the FLIRT protocol: every scan against every other"),
    "cascade": Experiment("what the shortlist loses"),
    "defaults": Experiment(
        "what each default is worth",
        ("--quick", "--stride", "16", "--only", *FEW),
    ),
    "robustness": Experiment("noise, changes, view, distance"),
    "pose_error": Experiment("errors of poses, and their covariances"),
    "calibration": Experiment("the probability of being right"),
    "clutter": Experiment("the simulated lab beside real logs"),
    "occupancy_grid": Experiment("localization in a grid map"),
    "maps": Experiment("Fig. 4 and 6 on real logs"),
    "office": Experiment("world models of simulated offices"),
    "tracks": Experiment("localization on real drives"),
    "course": Experiment("Fig. 7 and 4.B in simulation"),
    "volume": Experiment("Fig. 5, and what volumes hold, in simulation"),
    "kidnappings": Experiment("the kidnapped robot in simulation"),
    "soak": Experiment("a day of tracking with sources that fail"),
    "determinism": Experiment("every command twice, compared", ("info", "match")),
    "kills": Experiment("processes killed while they write", ("match", "--kills", "2")),
    "idc": Experiment("iterative dual correspondence"),
    "scan_classifier": Experiment("classes of real scans", ("--seeds", "1")),
    "image_classifier": Experiment("classes of simulated images", ("--floors", "1")),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, and say what failed; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="experiments (default: all)")
    parser.add_argument("--out", type=Path, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="small inputs: to see that they work")
    parser.add_argument("--list", action="store_true", help="name the experiments and run none")
    chosen = parser.parse_args(arguments)
    if chosen.list:
        for name, experiment in EXPERIMENTS.items():
            print(f"{name:18s}{experiment.what}")
        return 0
    for name in chosen.names:
        if name not in EXPERIMENTS:
            parser.error(f"{name}: no experiment has this name; see --list")
    if chosen.out is None:
        parser.error("--out: where to write is not told")
    names = list(dict.fromkeys(chosen.names)) or list(EXPERIMENTS)
    statuses, seconds = {}, {}
    for name in names:
        print(f"{name} …", file=sys.stderr, flush=True)
        began = time.monotonic()
        statuses[name] = run(name, chosen.out / name, chosen.quick)
        seconds[name] = time.monotonic() - began
        write_manifest(chosen.out, statuses, seconds, chosen.quick)
    failed = [name for name, status in statuses.items() if status]
    for name in failed:
        print(f"{name}: failed, see {chosen.out / name / 'output.txt'}", file=sys.stderr)
    return 1 if failed else 0


def run(name: str, out: Path, quick: bool) -> int:
    """One experiment; its exit status. What it prints goes to a file."""
    out.mkdir(parents=True, exist_ok=True)
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    with (out / "output.txt").open("wb") as file:
        return subprocess.run(
            [sys.executable, *EXPERIMENTS[name].words(name, out.resolve(), quick)],
            stdout=file,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONPATH": path},
            cwd=ROOT,
            check=False,
        ).returncode


def write_manifest(
    folder: Path, statuses: dict[str, int], seconds: dict[str, float], quick: bool
) -> None:
    """What was run, and apart from it what no two runs share."""
    manifest = {
        "quick": quick,
        "versions": {
            "python": sys.version.split()[0],
            "jax": jax.__version__,
            "numpy": np.__version__,
        },
        "experiments": {
            name: {
                "command": EXPERIMENTS[name].words(name, Path(name), quick),
                "status": status,
                "files": sorted(path.name for path in (folder / name).iterdir()),
            }
            for name, status in statuses.items()
        },
    }
    with atomic_write(folder / "manifest.json") as file:
        json.dump(manifest, file, indent=1, ensure_ascii=False)
    with atomic_write(folder / "times.csv") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([("experiment", "seconds"), *((n, f"{s:.1f}") for n, s in seconds.items())])


if __name__ == "__main__":
    sys.exit(main())
