"""Which readings are older than what their kind has told already, by their stamps."""

import logging
import math
from collections.abc import Mapping
from typing import Any

_log = logging.getLogger(__name__)

_AGAIN = 3
"""Late readings in a row, each later than the one before, that are of a new clock."""


class Clock:
    """The stamps of what came last, and of what came late since then.

    Stamps may stand still. Those of a new clock go far back, or go back again and again: a single
    late reading was delayed, and a run of them is a clock that was set anew, or a stamp before
    them that was wrong.
    """

    def __init__(self, late: float) -> None:
        """A stamp that goes back by more than `late` seconds is that of a new clock."""
        self._most = late
        self._last: dict[str, float] = {}
        self._late: dict[str, tuple[int, float]] = {}
        """How many in a row came late since, and the stamp of the last one of them."""

    def timely(self, call: str, stamp: float | None, readings: Mapping[str, Any]) -> dict[str, Any]:
        """Those of the readings of a `call` that do not come late."""
        if stamp is None:
            return dict(readings)
        if not math.isfinite(stamp):
            _log.warning("%s: the stamp %s is ignored", call, stamp)
            return dict(readings)
        return {
            name: reading for name, reading in readings.items() if self._on_time(call, name, stamp)
        }

    def state(self) -> dict[str, Any]:
        """All of it, as `json` writes it."""
        return {"last": dict(self._last), "late": {key: [*run] for key, run in self._late.items()}}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` returned."""
        self._last = dict(state["last"])
        self._late = {key: (count, stamp) for key, (count, stamp) in state["late"].items()}

    def _on_time(self, call: str, name: str, stamp: float) -> bool:
        key = f"{call} {name}"
        back = self._last.get(key, stamp) - stamp
        if 0 < back <= self._most:
            count, before = self._late.get(key, (0, -math.inf))
            if count == 0:
                _log.warning("%s: %s came %.3f s too late and is left out", call, name, back)
            if stamp != before:  # a repeated one is no other
                count = count + 1 if stamp > before else 1
                self._late[key] = (count, stamp)
            if count < _AGAIN:
                return False
        if back > 0:
            _log.warning("%s: the clock of %s went back by %.1f s", call, name, back)
        self._late.pop(key, None)
        self._last[key] = stamp
        return True
