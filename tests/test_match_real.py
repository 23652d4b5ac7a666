"""Global matching on public logs: two runs whose later passes are matched with the first."""

import gzip
from dataclasses import dataclass

import numpy as np
import pytest

from aprjax.batch import match_batch
from aprjax.io.logs import read_log
from aprjax.references import ReferenceSet
from aprjax.result import MatchResult
from aprjax.scan import Scan
from tests.oracles import evaluation as oracle

SPLITS = {"freiburg-079.revisit": 4, "fhw.revisit": 1}  # every how manyth query


@dataclass(frozen=True)
class Run:
    name: str
    result: MatchResult
    mirrored: MatchResult
    right: np.ndarray
    """Whether the best hypothesis of each query is right."""
    mapped: np.ndarray


def true_poses(path):
    """Laser poses of ROBOTLASER1 lines: after the readings and the remissions."""
    poses = []
    with gzip.open(path, "rt") as lines:
        for words in map(str.split, lines):
            if words and words[0] == "ROBOTLASER1":
                readings = int(words[8])
                remissions = int(words[9 + readings])
                start = 10 + readings + remissions
                poses.append([float(word) for word in words[start : start + 3]])
    return np.array(poses)


def mirrored(scan):
    return Scan.make(
        scan.ranges[::-1],
        angle_min=-float(scan.angle_min + (scan.beams - 1) * scan.angle_increment),
        angle_increment=float(scan.angle_increment),
        range_max=float(scan.range_max),
    )


@pytest.fixture(scope="module", params=SPLITS)
def run(request, data):
    folder, step = data / "splits" / request.param, SPLITS[request.param]
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    references = ReferenceSet.build([e.scan for e in read_log(folder / "references.log.gz")])
    queries = [e.scan for e in read_log(folder / "queries.log.gz")][::step]
    here = true_poses(folder / "references.log.gz")
    there = true_poses(folder / "queries.log.gz")[::step]
    result = match_batch(queries, references)
    right = []
    for pose, reference, T in zip(
        there, np.asarray(result.reference)[:, 0], np.asarray(result.T_ref_query)[:, 0], strict=True
    ):
        distance, angle = oracle.error(oracle.compose(here[reference], T), pose)
        right.append(reference >= 0 and distance < 0.5 and angle < np.radians(10))
    return Run(
        name=request.param,
        result=result,
        mirrored=match_batch([mirrored(scan) for scan in queries], references),
        right=np.array(right),
        mapped=np.loadtxt(folder / "mapped.txt", dtype=int).astype(bool)[::step],
    )


def test_the_best_hypothesis_of_a_mapped_query_is_right(run):
    assert run.mapped.sum() > 80
    assert run.right[run.mapped].mean() >= 0.93


def test_confident_answers_are_right_and_most_right_ones_are_confident(run):
    confident = np.asarray(run.result.confident)
    assert not np.any(confident & ~run.right)
    assert np.mean(confident[run.right & run.mapped]) >= 0.8


def test_a_mirrored_query_rates_below_the_true_one(run):
    """Even in freiburg-079, where the ends of the corridor are mirror images of themselves."""
    quality = np.asarray(run.result.quality)[:, 0]
    assert np.mean((run.mirrored.quality[:, 0] < quality)[run.right]) >= 0.98


def test_no_answer_to_a_mirrored_query_is_confident(run):
    if run.name == "freiburg-079.revisit":
        pytest.skip("freiburg-079's corridor ends are mirror images of themselves")
    assert not np.any(run.mirrored.confident)


def test_hypotheses_are_finite_ranked_and_within_bounds(run):
    for result in (run.result, run.mirrored):
        quality = np.asarray(result.quality)
        assert np.all(np.diff(quality, axis=1) <= 0)
        assert np.all((quality >= 0) & (quality <= 1))
        covariance = np.asarray(result.covariance, float)[np.asarray(result.valid)]
        assert np.all(np.isfinite(result.T_ref_query))
        assert np.all(np.linalg.eigvalsh(covariance) > 0)
