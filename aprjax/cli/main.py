"""The command `aprjax`: degrees and metres; results to files or standard output.

Exit status: 0, or 1 for bad data with one line on standard error, 2 for bad usage, 130 when
interrupted.
"""

import argparse
import io
import os
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

from aprjax.cli import demo, explain, info, localize, match, simulate, sweep
from aprjax.cli import map as map_
from aprjax.cli.errors import CommandError
from aprjax.compilation import cache_compilations


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand; the exit status. Bad usage raises argparse's `SystemExit`."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # of names and signs it cannot write
    arguments = _parser().parse_args(argv)
    try:
        if arguments.cache:
            cache_compilations()
        arguments.run(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return _fail("interrupted", 130)
    except BrokenPipeError:
        _give_up_output()  # whoever read it has closed it
        return 1
    except CommandError as error:
        return _fail(str(error), 1)
    except OSError as error:
        _give_up_output()
        # Files are named wherever they are read and written, which leaves standard output.
        stream = "standard output" if error.errno is not None else None
        place = error.filename or stream
        return _fail(": ".join(filter(None, (place, error.strerror or str(error)))), 1)
    except (ValueError, ArithmeticError) as error:
        return _fail(f"{type(error).__name__}: {error}", 1)  # whatever no reader had refused
    return 0


def _give_up_output() -> None:
    """Drop what standard output no longer takes; Python would complain once more at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(message: str, status: int) -> int:
    print("aprjax:", " ".join(message.splitlines()), file=sys.stderr)
    return status


def _version() -> str:
    try:
        return version("aprjax")
    except PackageNotFoundError:
        return "of a checkout that is not installed"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="aprjax", description="Global self-localization with a 2D laser scanner."
    )
    parser.add_argument("--version", action="version", version=f"aprjax {_version()}")
    parser.add_argument(
        "--cache",
        action="store_true",
        help="keep what is compiled for later runs, in ~/.cache/aprjax or $XDG_CACHE_HOME/aprjax",
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in (demo, match, explain, sweep, map_, localize, simulate, info):
        command.add_command(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
