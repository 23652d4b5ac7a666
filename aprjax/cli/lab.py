"""The simulated lab as commands offer it: its options, and building it."""

import argparse
import sys
import time

from aprjax.sim.lab import SCANS, Lab, lab
from aprjax.sim.laser import Laser

_LARGEST_SEED, _MOST_SCANS = 2**31 - 1, 100_000


def add_lab_options(parser: argparse.ArgumentParser) -> None:
    """Add what determines the lab to a subcommand's options."""
    parser.add_argument(
        "--seed",
        type=lambda text: _whole(text, 0, _LARGEST_SEED),
        default=0,
        metavar="N",
        help="same seed, same lab and same runs (default: 0)",
    )
    parser.add_argument(
        "--references",
        type=lambda text: _whole(text, 1, SCANS),
        default=30,
        metavar="N",
        help="reference scans, chosen from a first run (default: 30)",
    )
    parser.add_argument(
        "--scans",
        type=lambda text: _whole(text, 1, _MOST_SCANS),
        default=SCANS,
        metavar="N",
        help=f"scans of the second run (default: {SCANS})",
    )
    parser.add_argument(
        "--laser",
        choices=("sick", "full-turn"),
        default="sick",
        help="a scanner that sees the half turn ahead, or all around (default: sick)",
    )
    parser.add_argument(
        "--resolution",
        type=float,
        choices=(0.5, 1.0),
        default=0.5,
        metavar="DEG",
        help="degrees from beam to beam, 0.5 or 1 (default: 0.5)",
    )


def build_lab(arguments: argparse.Namespace) -> Lab:
    """The lab that the options ask for; a line on standard error says so."""
    start, resolution = time.monotonic(), arguments.resolution
    if arguments.laser == "sick":
        laser = Laser.sick(resolution)
    else:
        laser = Laser.full_turn(round(360 / resolution))
    built = lab(arguments.seed, arguments.references, arguments.scans, laser)
    print(
        f"lab {arguments.seed}: {arguments.references} references, {arguments.scans} scans of a "
        f"second run; simulated in {time.monotonic() - start:.1f} s",
        file=sys.stderr,
    )
    return built


def _whole(text: str, least: int, most: int) -> int:
    if not (text.isdecimal() and text.isascii() and least <= int(text) <= most):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least} to {most}")
    return int(text)
