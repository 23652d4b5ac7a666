"""One step of the robot from what several tracking sources measured of it, each at its own rate."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aprjax.plane import compose, compose_covariance, relative, wrap
from aprjax.tracking.hypothesis import Step
from aprjax.tracking.sources import TrackingSource

_EXACT = np.zeros((3, 3))


def fuse(steps: Sequence[Step]) -> Step:
    """The weighted mean of the steps, each number weighed by the inverse of its covariance.

    Errors of different sources are taken for independent. Numbers that no source measured stay
    unmeasured. Doubts add up as independent ones do.
    """
    doubt = 1.0 - float(np.prod([1.0 - step.doubt for step in steps]))
    measured = [step for step in steps if step.known.any()]
    if len(measured) == 1:
        return replace(measured[0], doubt=doubt)
    information, weighed = np.zeros((3, 3)), np.zeros(3)
    # Headings are averaged as differences from the first one, which are small.
    heading = next((float(s.T_before_now[2]) for s in measured if s.known[2]), 0.0)
    for step in measured:
        known = step.known
        part = np.ix_(known, known)
        # A step at rest is certain; the tiny variance keeps it invertible.
        own = np.zeros((3, 3))
        size = max(1.0, float(np.trace(step.covariance[part])))
        own[part] = np.linalg.inv(step.covariance[part] + 1e-12 * size * np.eye(int(known.sum())))
        T = step.T_before_now.copy()
        T[2] = wrap(np.asarray(T[2] - heading))
        information += own
        weighed += own @ np.where(known, T, 0.0)
    known = np.diag(information) > 0.0
    part = np.ix_(known, known)
    T, covariance = np.zeros(3), np.zeros((3, 3))
    covariance[part] = np.linalg.inv(information[part])
    T[known] = covariance[part] @ weighed[known]
    T[2] = wrap(np.asarray(T[2] + heading))
    return Step(T, _masked(0.5 * (covariance + covariance.T), known), doubt)


def filled(step: Step, variance: np.ndarray) -> Step:
    """The step with zero, of a `variance` `(3,)`, for each number that is not measured."""
    known = step.known
    if known.all():
        return step
    covariance = np.where(np.outer(known, known), step.covariance, 0.0)
    covariance += np.diag(np.where(known, 0.0, variance))
    return Step(np.where(known, step.T_before_now, 0.0), covariance, step.doubt)


class Motion:
    """The robot's motion since the last call, whichever sources have something to say of it.

    Every source measures the motion since its own last reading; hypotheses have been carried on
    meanwhile by what others measured. What a slower source then says corrects the sum of it, and
    adds the numbers that nobody has measured in between, such as the way beside a gyroscope. A
    correction makes no volume smaller: it may have been confirmed in between.
    """

    def __init__(self, unmeasured: float) -> None:
        """`unmeasured` is the deviation of numbers that no source measures: metres, radians."""
        self._unmeasured = unmeasured
        self._behind: dict[str, _Behind] = {}
        self._ever = np.zeros(3, bool)
        """Which numbers some source has measured at some time."""
        self.complete = False
        """Whether the last step measured all of these."""

    def step(
        self,
        sources: Iterable[TrackingSource],
        readings: Mapping[str, Any],
        ask: Callable[[TrackingSource, Any, Step | None], tuple[bool, Step | None]],
    ) -> Step | None:
        """What to carry hypotheses on by; None if nothing was measured.

        `ask` gives whether a source took its reading, and its step since the last one, if it has
        one. Numbers that are not measured now have the deviation `unmeasured`, but none if sources
        have measured them before: these will tell.
        """
        asked = [source for source in sources if source.reads in readings]
        read: set[str] = set()
        doubts: list[Step] = []

        def told(source: TrackingSource, expected: Step | None) -> list[Step]:
            taken, step = ask(source, readings[source.reads], expected)
            if taken:
                read.add(source.reads)
            if step is None:
                return []
            doubts.append(Step.unmeasured(step.doubt))
            return [replace(step, doubt=0.0)] if step.known.any() else []

        on_time = [source for source in asked if not self._of(source).moved]
        steps: list[Step] = []
        gap = False
        for source in sorted(on_time, key=lambda source: self._of(source).lost):
            lost = self._of(source).lost
            step = told(source, self._expected(fuse(steps)) if steps and not lost else None)
            # Who is lost tells of more than others saw, and is heard where nobody else measured.
            if step and not (lost and steps):
                steps += step
                gap = lost
        new = now = fuse(steps) if steps else None
        late = [source for source in asked if self._of(source).moved]
        for name in dict.fromkeys(source.reads for source in late):
            behind = self._behind[name]
            whole = [behind.step if now is None else _since(behind, new, now)]
            for source in late:
                if source.reads == name:
                    whole += told(source, None if behind.lost else self._expected(fuse(whole)))
            if len(whole) > 1 and not behind.lost:
                # Without anything new, this reading is of the same moment as the last one.
                still = Step(np.zeros(3), _masked(_EXACT, behind.step.known))
                better = _remaining(fuse(whole), behind.step)
                now = _corrected(still if now is None else now, better)
        self._remember(read, new, now, gap)
        total = fuse(doubts if now is None else [now, *doubts])
        if now is None and total.doubt == 0.0:
            return None
        self._ever |= total.known
        self.complete = bool(np.all(total.known == self._ever))
        return filled(total, np.where(self._ever, 0.0, self._unmeasured**2))

    def state(self) -> dict[str, Any]:
        """All of it, as `json` writes it."""
        behind = {
            name: {
                "T": each.step.T_before_now.tolist(),
                "covariance": np.where(each.step.known, each.step.covariance, 0.0).tolist(),
                "known": each.step.known.tolist(),
                "moved": each.moved,
                "lost": each.lost,
            }
            for name, each in self._behind.items()
        }
        return {"behind": behind, "ever": self._ever.tolist()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` returned."""
        self._ever = np.array(state["ever"], bool)
        self._behind = {
            name: _Behind(
                Step(
                    np.array(each["T"], float),
                    _masked(np.array(each["covariance"], float), np.array(each["known"], bool)),
                ),
                each["moved"],
                each["lost"],
            )
            for name, each in state["behind"].items()
        }

    def _of(self, source: TrackingSource) -> "_Behind":
        return self._behind.get(source.reads, _Behind())

    def _expected(self, step: Step) -> Step | None:
        """What a source is told of the step that it measures."""
        return filled(step, np.full(3, self._unmeasured**2)) if step.known.any() else None

    def _remember(self, read: set[str], new: Step | None, now: Step | None, gap: bool) -> None:
        """What others are behind with, now that these have been `read`.

        With a `gap`, the new motion began before their last readings: how much of it is theirs
        nobody knows.
        """
        others = self._behind.keys() - read
        for name in others:
            before = self._behind[name]
            since = _since(before, new, now)
            if gap:
                since = Step(since.T_before_now, Step.unmeasured().covariance)
            self._behind[name] = _Behind(since, before.moved or new is not None, before.lost)
        for name in read:
            before = self._behind.get(name)
            # Time has passed of which others will tell, with what was before this reading.
            lost = now is None and before is not None and not before.moved and bool(others)
            self._behind[name] = _Behind(lost=lost)


_STILL = Step(np.zeros(3), _EXACT)


@dataclass(frozen=True, eq=False)
class _Behind:
    """Where a name of readings stands behind what hypotheses were carried on by."""

    step: Step = _STILL
    """What they were carried on by since its last reading."""
    moved: bool = False
    """Whether they were carried on at all."""
    lost: bool = False
    """Whether others will tell of motion that began before its last reading."""


def _since(behind: _Behind, new: Step | None, now: Step | None) -> Step:
    """What a name that is `behind` has missed, with this call.

    That is the `new` motion. Of what slower sources say `now`, only numbers count that the motion
    before has lacked: the rest corrects what was, and is no motion.
    """
    step = behind.step if new is None else _follow(behind.step, new)
    missing = np.zeros(3, bool) if now is None else now.known & ~step.known
    if now is None or not behind.moved or not missing.any() or not step.known.any():
        return step
    T = compose(step.T_before_now, np.where(missing, now.T_before_now, 0.0))
    covariance = np.where(np.outer(missing, missing), now.covariance, step.covariance)
    known = step.known | missing
    return Step(T, _masked(np.where(np.isfinite(covariance), covariance, 0.0), known))


def _follow(first: Step, then: Step) -> Step:
    """One step after the other."""
    turn = bool(first.known[2] and then.known[2])
    way = bool(first.known[:2].all() and first.known[2] and then.known[:2].all())
    known = np.array([way, way, turn])
    covariance = compose_covariance(
        first.T_before_now, _finite(first), then.T_before_now, _finite(then)
    )
    return Step(compose(first.T_before_now, then.T_before_now), _masked(covariance, known))


def _remaining(whole: Step, done: Step) -> Step:
    """What is left of a step when `done` has been carried out, which is known exactly."""
    turned = np.array([0.0, 0.0, -done.T_before_now[2]])
    covariance = compose_covariance(turned, _EXACT, whole.T_before_now, _finite(whole))
    return Step(relative(done.T_before_now, whole.T_before_now), _masked(covariance, whole.known))


def _corrected(step: Step, better: Step) -> Step:
    """The `better` numbers; but the covariance stays where the step had one."""
    known, new = step.known, better.known & ~step.known
    covariance = np.where(np.outer(known, known), _finite(step), 0.0)
    covariance += np.where(np.outer(new, new), _finite(better), 0.0)
    T = np.where(better.known, better.T_before_now, step.T_before_now)
    return Step(T, _masked(covariance, known | new), step.doubt)


def _finite(step: Step) -> np.ndarray:
    """The covariance with zeros where nothing is measured."""
    return np.where(np.outer(step.known, step.known), step.covariance, 0.0)


def _masked(covariance: np.ndarray, known: np.ndarray) -> np.ndarray:
    """A covariance `(3, 3)` with infinite variances where numbers are not `known`."""
    return np.where(np.outer(known, known), covariance, np.diag(np.where(known, 0.0, np.inf)))
