"""`aprjax explain`: why one scan was answered as it was, as a page for a browser."""

import argparse
from pathlib import Path

import numpy as np

from aprjax.atomic import atomic_write
from aprjax.cli.errors import CommandError
from aprjax.cli.inputs import (
    add_references,
    gather_references,
    read_scans,
    warn_of_damage,
)
from aprjax.cli.outputs import check_output, shown_path
from aprjax.explanation.report import explain
from aprjax.matcher import MatchConfig


def add_command(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the subcommand to those of the parser."""
    parser = commands.add_parser(
        "explain",
        help="show how one scan was matched, as a page for a browser",
        description="Match one scan of a log with all reference scans, and write a page that "
        "shows why it was answered as it was: the scan, its hypotheses, and at which stage other "
        "references fell out. The page is one file that needs no network.",
    )
    add_references(parser)
    parser.add_argument(
        "--query", type=int, required=True, metavar="N", help="the scan's number, from 0"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="F.html")
    parser.add_argument(
        "--about",
        type=int,
        action="append",
        default=[],
        metavar="ID",
        help="also tell what became of this reference; may be repeated",
    )
    parser.add_argument(
        "--exclude-self",
        action="store_true",
        help="leave out the reference of the scan's own number, for a log against itself",
    )
    parser.add_argument(
        "--top-k",
        type=int,
        metavar="N",
        help="references to compare, those of the highest preselection value (default: all)",
    )
    parser.add_argument(
        "--no-cascade", action="store_true", help="go the paper's way: align all references"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Carry out the subcommand. Raises `CommandError` and `OSError`."""
    path, number = arguments.references, arguments.query
    check_output(arguments.out, path, arguments.queries)
    queries, report = read_scans(arguments.queries, arguments.topic)
    warn_of_damage(arguments.queries, report)
    if not 0 <= number < len(queries):
        raise CommandError(
            f"{arguments.queries}: there is no scan {number}, only 0 to {len(queries) - 1}"
        )
    references = gather_references(arguments)
    own = [number] if arguments.exclude_self and np.isin(number, references.ids) else []
    try:
        config = MatchConfig(top_k=arguments.top_k, cascade=not arguments.no_cascade)
    except ValueError as error:
        raise CommandError(str(error)) from None
    names = [shown_path(file.name) for file in (arguments.queries, path)]
    try:
        text = explain(
            queries[number],
            references,
            config,
            exclude=own,
            about=arguments.about,
            title=f"{names[0]}, scan {number}, in {names[1]}",
        )
    except ValueError as error:
        raise CommandError(f"{path}: {error}") from None
    with atomic_write(arguments.out) as file:
        file.write(text)
