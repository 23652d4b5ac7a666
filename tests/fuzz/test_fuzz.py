"""Every reader against good inputs, kept cases, and a few hundred blind changes of them."""

import os

import numpy as np
import pytest

from tests.fuzz.mutate import mutated
from tests.fuzz.targets import TARGETS, cases

COUNT = int(os.environ.get("APRJAX_FUZZ", "150"))
"""Changed inputs for each reader."""


@pytest.fixture(scope="module", params=TARGETS)
def target(request, tmp_path_factory):
    found = TARGETS[request.param]
    seeds = list(found.seeds(tmp_path_factory.mktemp("seeds")))
    return request.param, found, seeds


def test_good_inputs_are_read(target, tmp_path):
    _, reader, seeds = target
    # A database of ROS 2 without the metadata beside it is whole too.
    assert all(reader.check(data, tmp_path) for data in seeds)


def test_changed_inputs_are_read_or_refused_in_one_line(target, tmp_path):
    name, reader, seeds = target
    rng = np.random.default_rng(sum(name.encode()))
    good = [*seeds, *cases(name)]
    inputs = [mutated(good[rng.integers(len(good))], rng) for _ in range(COUNT)]
    outcomes = [reader.check(data, tmp_path) for data in inputs]
    assert not all(outcomes)


def test_kept_cases_are_read_or_refused_in_one_line(target, tmp_path):
    name, reader, _ = target
    for data in cases(name):
        reader.check(data, tmp_path)
