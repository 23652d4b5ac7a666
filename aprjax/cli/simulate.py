"""`aprjax simulate`: runs through the simulated lab as logs, with the truth beside them."""

import argparse
import csv
import sys
from pathlib import Path

from aprjax.atomic import atomic_write
from aprjax.cli.lab import add_lab_options, build_lab
from aprjax.cli.outputs import make_folder
from aprjax.io.carmen_writer import write_log
from aprjax.io.trajectory import write_tum
from aprjax.sim.run import Run


def add_command(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the subcommand to those of the parser."""
    parser = commands.add_parser(
        "simulate",
        help="write runs through a simulated lab as logs",
        description="Simulate two runs through an office floor and write logs that the other "
        "commands read: `first`, `second`, and `references`, the reference scans chosen from the "
        "first. Each has the odometry in its .log.gz, the true poses in its .tum, and the "
        "headings by gyro, in radians, in its .gyro.csv.",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder to write to, made if need be"
    )
    add_lab_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Carry out the subcommand. Raises `CommandError` and `OSError`."""
    folder = arguments.out
    make_folder(folder)
    lab = build_lab(arguments)
    runs = {"references": lab.references, "first": lab.reference_run, "second": lab.queries}
    for name, each in runs.items():
        _write_run(folder, name, each)
        print(f"{folder / name}.log.gz: {len(each.stamps)} scans", file=sys.stderr)


def _write_run(folder: Path, name: str, run: Run) -> None:
    write_log(folder / f"{name}.log.gz", run.scans, run.odometry, run.stamps)
    write_tum(folder / f"{name}.tum", run.stamps, run.T_world_laser)
    with atomic_write(folder / f"{name}.gyro.csv") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("stamp", "heading"))
        for stamp, heading in zip(run.stamps, run.gyro, strict=True):
            table.writerow((f"{stamp:.6f}", f"{heading:.9f}"))
