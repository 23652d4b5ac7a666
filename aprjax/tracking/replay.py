"""A drive that was recorded, played to a tracker as it would have come."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax

from aprjax.batch import match_batch
from aprjax.io.carmen import LogEntry
from aprjax.matcher import MatchConfig
from aprjax.result import MatchResult
from aprjax.scan import Scan
from aprjax.tracking.apr import AprSource
from aprjax.tracking.belief import Belief
from aprjax.tracking.tracker import HypothesisTracker
from aprjax.world.model import WorldModel

PIECE = 64
"""Scans that are matched in one call."""


def replay(
    tracker: HypothesisTracker,
    entries: Sequence[LogEntry],
    progress: Callable[[int], None] | None = None,
    **more: Sequence[Any],
) -> Iterator[Belief]:
    """What is believed after each scan of a log with odometry.

    The tracker's primary source should be a `MatchedSource`: scans are matched ahead of it, many in
    one call. `more` are other readings, one a scan, named as the sources' `reads`, such as `image`.
    `progress` is told how many more scans have been dealt with.
    """
    for number, (entry, match) in enumerate(matched(tracker.world, entries)):
        # Stamps of logs may be constant or made up: the order of the lines is the time.
        tracker.move(odometry=entry.odometry, scan=entry.scan)
        own = {name: readings[number] for name, readings in more.items()}
        yield tracker.observe(match=match, scan=entry.scan, **own)
        if progress is not None:
            progress(1)


def matched(
    world: WorldModel, entries: Sequence[LogEntry], config: MatchConfig | None = None
) -> Iterator[tuple[LogEntry, MatchResult]]:
    """The entries of a log, each with what the matcher makes of its scan.

    The matcher knows nothing of the scans before, so that many can be matched in one call; empty
    ones fill up the last piece.
    """
    if not entries:
        return
    config = AprSource().config if config is None else config
    size = min(PIECE, len(entries))
    slots = max(int(entry.scan.beams) for entry in entries)
    for start in range(0, len(entries), size):
        piece = entries[start : start + size]
        batch = Scan.stack([entry.scan for entry in piece], slots).pad_batch(size)
        results = jax.device_get(match_batch(batch, world.references, config))
        for number, entry in enumerate(piece):
            yield entry, jax.tree.map(lambda array: array[number], results)  # noqa: B023
