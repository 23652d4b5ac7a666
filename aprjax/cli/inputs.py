"""Logs and reference files as the commands read them: what is wrong becomes a `CommandError`."""

import sys
from pathlib import Path

from aprjax.cli.errors import CommandError
from aprjax.io.carmen import LogError, LogReport, read_log
from aprjax.io.reference_file import ReferenceFileError, load_references, looks_like_references
from aprjax.references import ReferenceSet
from aprjax.scan import Scan

_SHOWN = 3  # damaged lines spelled out


def holds_references(path: Path) -> bool:
    """Whether the file is a saved reference set rather than a log."""
    try:
        return looks_like_references(path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None


def open_references(path: Path) -> ReferenceSet:
    """A saved reference set."""
    try:
        return load_references(path)
    except ReferenceFileError as error:
        raise CommandError(str(error)) from None


def read_scans(path: Path, *, strict: bool = False) -> tuple[list[Scan], LogReport]:
    """All scans of a log, and what it holds; nothing else of it is looked at."""
    try:
        log = read_log(path, strict=strict)
        return [entry.scan for entry in log], log.report
    except LogError as error:
        raise CommandError(str(error)) from None


def warn_of_damage(path: Path, report: LogReport) -> None:
    """Say on standard error how many lines were skipped as damaged, and why the first ones."""
    if not report.damaged_lines:
        return
    print(f"{path}: skipped {report.damaged_lines} damaged lines", file=sys.stderr)
    for line, reason in report.damaged[:_SHOWN]:
        print(f"  line {line}: {reason}", file=sys.stderr)
