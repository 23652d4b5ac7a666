"""Anchors and surfaces of one scan in plain NumPy, from the tests' oracles.

For scanners of less than a full turn. Virtual edges are the one thing that is done otherwise than
in `aprjax`: their lines are grown from the longest pieces of surface, not found by histograms.
"""

from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np

import aprjax
from aprjax.configuration import to_dict
from tests.oracles import alignment, anchors, relations

FEATURES = to_dict(aprjax.FeatureConfig())


def describe(scan: aprjax.Scan) -> SimpleNamespace:
    """Anchors `(xy, valid)`, edges, and what else `aprjax.evaluation.view.View` holds."""
    extraction: dict[str, Any] = FEATURES["extraction"]
    limits = (scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max)
    measured = anchors.Beams(np.asarray(scan.ranges)[: int(scan.beams)], *map(float, limits))
    rules, jump = extraction["segment"], extraction["jump_edge"]
    window = [extraction["surface"][name] for name in ("window", "spacings", "samples")]
    beams = measured.bridged(*(rules[name] for name in ("bridge", "dropout", "gap", "incidence")))
    parts = anchors.parts(beams, rules["gap"], rules["incidence"])
    large = [
        part
        for part in parts
        if anchors.is_large(beams, part, rules["min_extent"], rules["min_beams"])
    ]
    normal, linked = np.zeros((beams.count, 2)), np.zeros(beams.count, bool)
    corners, pieces = [], []
    for part in parts:
        linked[part[:-1]] = [measured.hit[i] and measured.hit[i + 1] for i in part[:-1]]
        for place, i in enumerate(part):
            before, after = (anchors.side(beams, part, place, way, *window) for way in (-1, 1))
            if len(before) + len(after) < 3:
                continue
            _, direction, _, rms = anchors.line([*before, beams.xy[i], *after])
            if measured.hit[i] and rms <= FEATURES["view"]["max_rms"]:
                normal[i] = -np.sin(direction), np.cos(direction)
            if part not in large:
                continue
            corners += _corner(beams.xy[i], before, after, extraction["angle"])
            if len(before) + len(after) >= 4 and rms <= extraction["virtual_edge"]["max_rms"]:
                ends = beams.xy[[part[max(place - 1, 0)], part[min(place + 1, len(part) - 1)]]]
                along = (ends[1] - ends[0]) @ [np.cos(direction), np.sin(direction)]
                pieces.append([*beams.xy[i], direction, abs(along) / 2])
    edges = anchors.jump_edges(beams, large, jump["jump"], jump["relative"], jump["weight"])
    virtual = _virtual_edges(np.reshape(pieces, (-1, 4)), extraction["virtual_edge"])
    chosen: list[np.ndarray] = []
    for point in sorted([*edges, *corners, *virtual], key=lambda point: -point[2]):
        if all(np.hypot(*(point[:2] - other)) >= extraction["apart"] for other in chosen):
            chosen.append(np.asarray(point[:2]))
    points = np.reshape(chosen[: extraction["anchors"]], (-1, 2))
    known = np.where(measured.free, measured.limit, np.where(measured.hit, measured.ranges, 0.0))
    return SimpleNamespace(
        graph=(points, np.ones(len(points), bool)),
        edges=relations.edges(points, np.ones(len(points), bool)),
        xy=measured.xy,
        range=known,
        hit=np.array(measured.hit),
        linked=linked,
        normal=normal,
        angle_min=measured.angle_min,
        angle_increment=measured.step,
        beams=measured.count,
    )


def _corner(here, before, after, rules: dict) -> list[list[float]]:
    """The angle anchor at a hit, if there is one: x, y, salience."""
    if min(len(before), len(after)) < 3:
        return []
    headings, faces = [], []
    for points, sign in ((before, -1), (after, 1)):
        centre, direction, spread, rms = anchors.line(points)
        if spread < rules["min_spread"] or rms > rules["max_rms"]:
            return []
        ahead = sign * (centre - here) @ [np.cos(direction), np.sin(direction)]
        headings.append(direction if ahead >= 0 else direction + np.pi)
        faces.append((centre, direction, rms))
    turn = alignment.apart(headings[0], headings[1], 2 * np.pi)
    if not rules["min_angle"] <= turn <= rules["max_angle"]:
        return []
    (centre_a, direction_a, rms_a), (centre_b, direction_b, rms_b) = faces
    corner = anchors.intersection(centre_a, direction_a, centre_b, direction_b)
    offset = np.hypot(*(corner - here))
    straight = np.exp(-0.5 * (max(rms_a, rms_b) / rules["max_rms"]) ** 2)
    nearness = 1 - 0.5 * offset / rules["max_offset"]
    salience = rules["weight"] * abs(np.sin(turn)) * straight * nearness
    return [[*corner, salience]] if offset <= rules["max_offset"] else []


def _virtual_edges(pieces: np.ndarray, rules: dict) -> list[list[float]]:
    """Where lines through pieces of surface (x, y, direction, length) meet: x, y, salience."""
    lines, left = [], pieces[:, 3].copy()
    for _ in range(rules["directions"] * rules["lines"]):
        if not left.any():
            break
        x, y, direction, _ = pieces[np.argmax(left)]
        off = (pieces[:, 1] - y) * np.cos(direction) - (pieces[:, 0] - x) * np.sin(direction)
        turned = (pieces[:, 2] - direction + np.pi / 2) % np.pi - np.pi / 2
        on = (np.abs(off) <= rules["width"]) & (np.abs(turned) <= rules["spread"]) & (left > 0)
        length, left = left[on].sum(), np.where(on, 0.0, left)
        if length >= rules["min_length"] and on.sum() >= 2:
            centre, direction, *_ = anchors.line(pieces[on, :2])
            along = (pieces[on, :2] - centre) @ [np.cos(direction), np.sin(direction)]
            lines.append((centre, direction, along.min(), along.max(), length))
    found = []
    for a, b in combinations(lines, 2):
        sine = abs(np.sin(a[1] - b[1]))
        if sine < np.sin(rules["min_angle"]):
            continue
        xy = anchors.intersection(a[0], a[1], b[0], b[1])
        along = [(xy - line[0]) @ [np.cos(line[1]), np.sin(line[1])] for line in (a, b)]
        past = [max(s - line[3], line[2] - s, 0.0) for s, line in zip(along, (a, b), strict=True)]
        beyond, length = max(past), min(a[4], b[4])
        if beyond <= min(rules["elongation"], 2 * length):
            certain = min(length, 2.0) / 2 / (1 + beyond / rules["elongation"])
            found.append([*xy, rules["weight"] * sine * certain])
    return found
