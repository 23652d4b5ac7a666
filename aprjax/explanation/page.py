"""An account of one query as a page for a browser."""

from collections.abc import Sequence
from html import escape

import jax
import numpy as np

from aprjax.explanation.html import document, picture, section, table
from aprjax.explanation.stages import Account, Stage
from aprjax.matcher import MatchConfig
from aprjax.plot.alignment import draw_correspondences, draw_matching_angles
from aprjax.plot.anchors import draw_anchors
from aprjax.plot.answer import draw_answer
from aprjax.plot.match import draw_match
from aprjax.plot.scan import draw_scan
from aprjax.plot.style import figure_of
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.se2 import Pose
from aprjax.status import Status

_OVERLAYS = 3  # hypotheses that are drawn
_REJECTED = 2  # references without a hypothesis that are drawn, besides those asked about
_ROWS = 12  # of them in the table

_SAYS = {
    Status.OK: "There is an answer, and nothing else explains the scan as well.",
    Status.AMBIGUOUS: "Another place explains the scan about as well as the best hypothesis.",
    Status.CAPACITY_EXCEEDED: "There is an answer; the scan had more anchors than were used.",
    Status.TOO_FEW_ANCHORS: "The scan shows fewer than two anchors: there is no edge to compare.",
    Status.NO_CANDIDATE: "No reference shares enough edges with the scan to be aligned.",
    Status.BELOW_THRESHOLD: "There were alignments, but none reached the least quality.",
}

_FELL = {
    Stage.NOT_COMPARED: "not compared: excluded, or its q_m is not among the highest",
    Stage.ALIGNMENT: "alignment: too few edges agree on any pose in it",
    Stage.GLANCE: "glance: other alternatives fit better at first sight, or lie at likelier places",
    Stage.SECOND_LOOK: "second look: too few anchors agree, or other alternatives fit better",
    Stage.EVALUATION: "evaluation: its e_m is too low, or lower than those of the hypotheses",
    Stage.ANSWERED: "nowhere: it is among the hypotheses",
}


def page(
    told: Account,
    scan: Scan,
    references: ReferenceSet,
    config: MatchConfig,
    about: Sequence[int],
    title: str,
) -> str:
    """The page of one account; `about` are ids of references to be told of in any case."""
    parts = [
        f"<h1>{escape(title)}</h1>",
        _answer(told, config),
        section("The scan", _scan_pictures(told, scan, references)),
        _hypotheses(told, references),
        section(
            "The best hypotheses, laid over their references", _overlays(told, scan, references)
        ),
        _map(told, references),
        _alignment(told, references, config),
        _rejected(told, scan, references, config, about),
    ]
    return document(title, "\n".join(part for part in parts if part))


def _answer(told: Account, config: MatchConfig) -> str:
    """What came of it, in words and in numbers left after each stage."""
    result, counts = told.result, told.result.counts
    status = Status(int(result.status))
    acted = "may be acted on" if result.confident else "must not be acted on: the robot is lost"
    words = f"Status <b>{escape(status.text)}</b>. {escape(_SAYS[status])}"
    if result.valid[0]:
        words += (
            f" The best hypothesis {acted} (quality {result.quality[0]:.3f}; it takes "
            f"{float(config.confident):.3f} and no rival)."
        )
    passed = sum(fate.passed for fate in told.fates)
    rows = [
        ("anchors of the scan", counts.anchors),
        ("anchors that the capacity left out", counts.overflow),
        ("references", len(told.fates)),
        ("references with an alternative", counts.aligned),
        ("alternatives in them", counts.alternatives),
    ]
    if config.cascade:
        rows.append(("alternatives that passed the glance", passed))
    rows += [
        ("alternatives evaluated by synthetic scans", counts.evaluated),
        ("hypotheses", int(np.sum(result.valid))),
    ]
    left = table(("stage", "left"), [(name, str(int(number))) for name, number in rows], "stage")
    return f"<p>{words}</p>{left}"


def _scan_pictures(told: Account, scan: Scan, references: ReferenceSet) -> list[str]:
    anchors, graph = told.query.anchors, told.query.graph
    drawn = draw_scan(scan, references.config.extraction.segment)
    drawn += draw_anchors(anchors, ax=figure_of(drawn).axes[0])
    return [
        picture(drawn, "The scan with its anchor points."),
        picture(draw_anchors(anchors, graph), "The anchor point graph, whose edges are compared."),
    ]


def _hypotheses(told: Account, references: ReferenceSet) -> str:
    """The ranked table."""
    result = told.result
    if not result.valid[0]:
        return ""
    heads = (
        *("", "reference", "x\u00a0/\u00a0m", "y\u00a0/\u00a0m", "θ\u00a0/\u00a0°", "q_m"),
        *(
            "agreeing anchors",
            "agreeing beams",
            "e_m",
            "e_m less rivals",
            "probability",
            "excludes the best",
        ),
    )
    rows = []
    for k in np.flatnonzero(result.valid):
        x, y, theta = result.T_ref_query[k]
        rows.append(
            (
                *(str(k), str(result.reference[k]), f"{x:z.2f}", f"{y:z.2f}"),
                *(f"{np.degrees(theta):z.1f}", f"{result.preselection[k]:.2f}"),
                *(str(result.agreeing_anchors[k]), str(result.agreeing_beams[k])),
                *(_number(told.e_m[k]), f"{result.quality[k]:.3f}"),
                *(f"{result.probability[k]:.3f}", _number(told.rivalry[k]) if k else ""),
            )
        )
    note = (
        "Poses are those of the query's laser in the reference scan's frame. A hypothesis that "
        "excludes the best (1: cannot hold together with it; 0: means the same place) is a rival, "
        "and costs the best a share of its own e_m."
    )
    return f"<h2>Hypotheses, best first</h2><div class=wide>{table(heads, rows)}</div><p>{note}</p>"


def _overlays(told: Account, scan: Scan, references: ReferenceSet) -> list[str]:
    result = told.result
    return [
        _overlay(
            scan,
            references,
            int(result.reference[k]),
            result.T_ref_query[k],
            float(result.quality[k]),
            f"Hypothesis {k}: reference {result.reference[k]}.",
        )
        for k in np.flatnonzero(result.valid)[:_OVERLAYS]
    ]


def _map(told: Account, references: ReferenceSet) -> str:
    known = references.ids[np.isfinite(references.T_world_ref).all(axis=1)]
    if not np.isin(told.result.reference, known).any():
        return ""
    drawn = draw_answer(told.result, references)
    return section("In the references' own frame", [picture(drawn, "The hypotheses.")])


def _alignment(told: Account, references: ReferenceSet, config: MatchConfig) -> str:
    """The paper's alignment with the reference that came first."""
    if not told.result.valid[0]:
        return ""
    best = int(told.result.reference[0])
    row = int(np.flatnonzero(references.ids == best)[0])
    reference = jax.tree.map(lambda array: array[row], references.index.features.graph)
    query, alignment = told.query.graph, config.alignment
    relation, angle = references.config.relation, float(told.result.T_ref_query[0, 2])
    pictures = [
        picture(
            draw_matching_angles(reference, query, relation, alignment.rotation),
            f"Matching angle histogram with reference {best}; the answer has "
            f"{np.degrees(angle) % 180:.0f}°.",
        ),
        picture(
            draw_correspondences(reference, query, angle, alignment.correspondence),
            "Correspondence matrix at the answer's rotation.",
        ),
    ]
    how = (
        "The paper aligns by these two (2.C). Here the edges voted for poses at once, which takes "
        "neither; they show how clear the answer would be to the paper's way."
        if config.cascade
        else "This is how the alternatives were found (2.C of the paper)."
    )
    return f"{section('Edges and anchors that correspond', pictures)}<p>{how}</p>"


def _rejected(
    told: Account,
    scan: Scan,
    references: ReferenceSet,
    config: MatchConfig,
    about: Sequence[int],
) -> str:
    """The references without a hypothesis, and those asked about."""
    out = [fate for fate in told.fates if fate.stage != Stage.ANSWERED]
    asked = [fate for fate in told.fates if fate.reference in about]
    shown = [*asked, *(fate for fate in out if fate not in asked)]
    listed = shown[: max(_ROWS, len(asked))]
    if not listed:
        return ""
    by_q_m = sorted((fate.q_m for fate in told.fates), reverse=True)
    looks = ("after the glance", "after the second look") if config.cascade else ()
    heads = ("reference", "q_m", "rank by q_m", "alternatives", *looks, "best e_m", "fell out at")
    rows = []
    for fate in listed:
        left = (fate.passed, fate.kept) if config.cascade else ()
        rows.append(
            (
                *(str(fate.reference), f"{fate.q_m:.2f}", str(by_q_m.index(fate.q_m) + 1)),
                *(str(count) for count in (fate.aligned, *left)),
                *(f"{fate.e_m:.3f}" if fate.kept else "", _FELL[fate.stage]),
            )
        )
    rest = len(out) - sum(fate in out for fate in listed)
    more = f"<p>{rest} more references have no hypothesis.</p>" if rest else ""
    drawn = [*asked, *[fate for fate in out if fate not in asked][:_REJECTED]]
    overlays = [
        _overlay(
            scan,
            references,
            fate.reference,
            fate.T_ref_query,
            None,
            f"Reference {fate.reference}, its most promising alternative"
            + (
                ", among the hypotheses."
                if fate.stage == Stage.ANSWERED
                else f". It fell out at: {_FELL[fate.stage]}."
            ),
        )
        for fate in drawn
        if fate.T_ref_query is not None
    ]
    fates = f"<div class=wide>{table(heads, rows, words=heads[-1])}</div>"
    pictures = f"<div class=pictures>{''.join(overlays)}</div>"
    return f"<h2>Why not another reference</h2>{fates}{more}{pictures}"


def _overlay(
    scan: Scan,
    references: ReferenceSet,
    reference: int,
    T_ref_query: Pose,
    quality: float | None,
    caption: str,
) -> str:
    row = int(np.flatnonzero(references.ids == reference)[0])
    theirs = jax.tree.map(lambda array: np.asarray(array)[row], references.scans)
    drawn = draw_match(theirs, scan, T_ref_query, quality, references.config)
    return picture(drawn, caption)


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "–"
