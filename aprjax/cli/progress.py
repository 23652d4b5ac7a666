"""Progress on standard error: a bar on a terminal, else a plain line now and then."""

import sys
import time
from types import TracebackType
from typing import Self, TextIO

_WIDTH = 30  # characters of the bar
_SILENCE = 10.0  # seconds between two plain lines


class Progress:
    """Counts `total` items of some work; a context manager around it."""

    def __init__(self, work: str, total: int, stream: TextIO | None = None) -> None:
        """`work` says what is done, such as "matching"."""
        self._work, self._total, self._done = work, total, 0
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._start = self._spoken = time.monotonic()

    def __enter__(self) -> Self:
        if self._terminal:
            self._draw()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._terminal:
            print(file=self._stream, flush=True)

    def advance(self, count: int) -> None:
        """`count` more items are done."""
        self._done += count
        now = time.monotonic()
        if self._terminal:
            self._draw()
        elif now - self._spoken >= _SILENCE and self._done < self._total:
            self._spoken = now
            print(f"{self._work}: {self._state()}", file=self._stream, flush=True)

    def _draw(self) -> None:
        full = _WIDTH * self._done // max(self._total, 1)
        bar = "#" * full + "." * (_WIDTH - full)
        print(f"\r{self._work} [{bar}] {self._state()}", end="", file=self._stream, flush=True)

    def _state(self) -> str:
        return f"{self._done} of {self._total}, {time.monotonic() - self._start:.0f} s"
