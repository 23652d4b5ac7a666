"""The outcomes of a match: one enumeration, carried as data so that a batch never raises."""

import enum


class Status(enum.IntEnum):
    """What became of one query.

    The order is that of the stages; a query gets the first that applies, except that
    `CAPACITY_EXCEEDED` marks an otherwise good answer from which something was left out.
    """

    OK = 0
    """There is at least one hypothesis, and the best one has no equal rival."""
    AMBIGUOUS = 1
    """As OK, but another place explains the scan about as well as the best hypothesis.

    That is another pose in its reference, or one in a reference whose scan contradicts it. Where
    the poses of both references are known (`T_world_ref`), it is any other pose in their frame,
    whether the scans contradict each other or look the same.
    """
    CAPACITY_EXCEEDED = 2
    """As OK, but the scan had more anchors than the capacity; the most salient were used."""
    TOO_FEW_ANCHORS = 3
    """Fewer than two anchors: no edge to compare. Empty, invalid and one-beam scans end here."""
    NO_CANDIDATE = 4
    """No reference shares enough edge lengths and angles with the query to be aligned."""
    BELOW_THRESHOLD = 5
    """There were alignments, but the quality of none reached `MatchConfig.min_quality`."""

    @property
    def text(self) -> str:
        """The name as result tables print it, such as `too_few_anchors`."""
        return self.name.lower()
