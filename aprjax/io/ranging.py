"""What logged ranges mean: hits, no returns, sensor codes and saturation values."""

import numpy as np

from aprjax.io.messages import Sweep
from aprjax.scan import Scan

_RANGE_MIN, _RANGE_MAX = 0.02, 80.0  # metres, where the log shows no others
_SICK_ABOVE_MAXIMUM = 81.83
_SICK_CODES = 81.825  # metres: this and all above it is a code
BINS = 81_830  # a histogram of the readings below the codes, a millimetre each


class Ranging:
    """What the readings of one laser mean, judged by all of them."""

    def __init__(self, counts: np.ndarray) -> None:
        """`counts` are the log's readings of each length in whole millimetres."""
        self._longer = counts[::-1].cumsum()[::-1]
        self.saturation = saturation_value(counts)

    def scan(self, sweep: Sweep) -> Scan:
        """The sweep's ranges as REP 117 has them.

        No return: +inf, SICK's code 81.83 for above maximum, and a reading at the limit; beyond
        it too if the limit is a saturation value. Invalid: other codes (81.87 signal too weak,
        81.89 overflow, 81.90 dazzled, 81.91 not valid) and anything else beyond the limit, not
        positive or not a number.
        """
        ranges, limit = sweep.ranges, self.limit(sweep.maximum)
        with np.errstate(invalid="ignore"):
            code = ranges >= _SICK_CODES
            free = np.isposinf(ranges) | (abs(ranges - _SICK_ABOVE_MAXIMUM) <= 0.005)
            if self.saturation is not None:
                free |= ~code & (ranges > self.saturation - 0.001)
            elif limit is not None:
                free |= abs(ranges - limit) <= 0.001
            invalid = code | (ranges <= 0)
        range_max = limit or _RANGE_MAX
        return Scan.make(
            np.where(free, np.inf, np.where(invalid, np.nan, ranges)),
            angle_min=sweep.start,
            angle_increment=sweep.resolution,
            range_min=_RANGE_MIN,
            range_max=range_max,
        )

    def limit(self, header: float | None) -> float | None:
        """The laser's range in metres: its saturation value, else a header's believable maximum.

        That is one between 1 m and SICK's codes which at most a thousandth of the readings
        exceed.
        """
        if self.saturation is not None:
            return self.saturation
        if header is None or not 1 <= header < _SICK_CODES:
            return None
        exceeding = self._longer[round(header * 1e3) + 1]
        return header if exceeding <= self._longer[0] / 1e3 else None


def saturation_value(counts: np.ndarray) -> float | None:
    """The length in metres that a scanner reports for all that is farther, None without one.

    `counts[i]` is how often a log reads i millimetres, SICK's codes left out. A saturation value
    is a sharp peak at the very end of this histogram. It is read at least 20 times, and ten times
    as often as any value from 80 % of its length up to it. Longer readings, which some scanners
    jitter up to (51.05 and some 51.10), are at most a quarter as many. Isolated far readings fail
    the first test. So does a wall that a standing robot looks at: noise spreads its readings to
    both sides, and its width to the far one. (A wall of a few beams, the farthest of the log and
    with less noise than a reading's last digit, is mistaken.) And the log must hold 20 different
    shorter values, or nothing says that a constant is not what there was to see.
    """
    longer = counts[::-1].cumsum()[::-1]
    for value in np.flatnonzero(counts >= 20)[::-1]:
        peak = counts[value]
        ordinary = counts[int(0.8 * value) : value].max(initial=0)
        if 4 * (longer[value] - peak) <= peak >= 10 * ordinary:
            varied = np.count_nonzero(counts[:value]) >= 20
            return float(value) / 1e3 if varied else None
    return None


def in_millimetres(ranges: np.ndarray) -> np.ndarray:
    below = ranges[(ranges > 0) & (ranges < _SICK_CODES)]
    return np.bincount(np.rint(below * 1e3).astype(np.int64), minlength=BINS)
