import jax
import numpy as np
import pytest

from aprjax import Catalogue, ReferenceSet, Scan, match, match_catalogue
from aprjax.catalogue import catalogue as module
from aprjax.catalogue import match as matching
from aprjax.catalogue.match import most_alike
from tests.worlds import free_pose, office, scan_at


@pytest.fixture(scope="module")
def scans():
    rng, world = np.random.default_rng(5), office(seed=3)
    poses = [free_pose(world, rng) for _ in range(12)]
    near = [pose + np.array([0.2, 0.05, 0.1]) for pose in poses[:5]]
    return [scan_at(world, pose, noise=0.01, rng=rng) for pose in (*poses, *near)]


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(module, "BLOCK", 8)
    monkeypatch.setattr(matching, "BLOCK", 8)


def test_references_added_piece_by_piece_are_those_of_one_catalogue(small_blocks, scans):
    whole = Catalogue.build(scans)
    pieces = Catalogue.build(scans[:3]).add(scans[3:9]).add(scans[9:])
    assert [len(block) for block in whole.blocks] == [8, 8, 1]
    assert len(pieces) == len(whole) == len(scans)
    for one, other in zip(pieces.blocks, whole.blocks, strict=True):
        np.testing.assert_array_equal(one.scans.ranges, other.scans.ranges)
        np.testing.assert_allclose(one.signatures, other.signatures, atol=1e-4)
    assert pieces.add(scans[:1]).blocks[0] is pieces.blocks[0]


def test_what_a_catalogue_was_built_from_may_change_and_it_does_not(scans):
    stack = Scan.stack(scans)
    catalogue = Catalogue.build(stack)
    kept = jax.tree.map(np.copy, catalogue.blocks[0].scans)
    for leaf in jax.tree.leaves(stack):
        leaf[:] = 7
    for ours, wanted in zip(*map(jax.tree.leaves, (catalogue.blocks[0].scans, kept)), strict=True):
        np.testing.assert_array_equal(ours, wanted)


def test_scans_are_given_back_by_their_ids(small_blocks, scans):
    ids = np.array([16, 0, 9, 0, 3])
    found = Catalogue.build(scans).scans(ids)
    for row, number in enumerate(ids):
        np.testing.assert_array_equal(found.ranges[row, :181], scans[number].ranges)


def test_those_most_alike_are_the_greatest_products_over_all_blocks(small_blocks, scans):
    catalogue = Catalogue.build(scans)
    known = np.concatenate([np.asarray(b.signatures)[: len(b)] for b in catalogue.blocks])
    batch = Scan.stack(scans[12:])
    exclude = np.array([[k, -1] for k in range(5)])
    likeness = catalogue.signatures(batch.pad(catalogue.slots)) @ known.T
    likeness[np.arange(5), np.arange(5)] = -np.inf
    found = most_alike(batch, catalogue, 6, exclude=exclude)
    np.testing.assert_array_equal(found, np.argsort(-likeness, axis=1, kind="stable")[:, :6])
    every = most_alike(batch, catalogue, 20, exclude=exclude)
    assert np.all(np.sum(every == -1, axis=1) == 4)


def test_equals_are_in_the_order_of_their_ids(small_blocks, scans):
    catalogue = Catalogue.build([scans[0]] * 11)
    np.testing.assert_array_equal(most_alike(Scan.stack(scans[:1]), catalogue, 10)[0], range(10))


def test_where_all_are_likely_the_answers_are_those_of_a_reference_set(small_blocks, scans):
    known, queries = scans[:8], [*scans[12:], scans[3]]
    exclude = np.full((len(queries), 1), -1)
    exclude[-1] = 3
    near = match_catalogue(queries, Catalogue.build(known), exclude=exclude)
    # One at a time and of eight: a shape that other tests compile too.
    references = ReferenceSet.build(known)
    single = [match(q, references, exclude=e) for q, e in zip(queries, exclude, strict=True)]
    whole = jax.tree.map(lambda *leaves: np.stack(leaves), *single)
    # Alternatives of one place, 0.21 mm apart, have the same e_m to the bit: either may be best.
    for (path, one), other in zip(
        jax.tree_util.tree_leaves_with_path(near), jax.tree.leaves(whole), strict=True
    ):
        name = jax.tree_util.keystr(path)
        assert one.dtype == other.dtype
        if np.issubdtype(one.dtype, np.floating):
            allowed = 3e-4 if name == ".T_ref_query" else 2e-4
            np.testing.assert_allclose(one, other, atol=allowed, err_msg=name)
        else:
            np.testing.assert_array_equal(one, other, err_msg=name)
    assert near.reference[:5, 0].tolist() == list(range(5))
    assert 3 not in near.reference[-1]


def test_a_stack_that_is_padded_wider_than_the_catalogue_fits_by_its_beams(scans):
    catalogue = Catalogue.build(scans[:2])
    wide = catalogue.add(Scan.stack(scans[2:4], slots=catalogue.slots + 64))
    for one, other in zip(wide.blocks, catalogue.add(scans[2:4]).blocks, strict=True):
        np.testing.assert_array_equal(one.signatures, other.signatures)
        jax.tree.map(np.testing.assert_array_equal, one.scans, other.scans)


def test_bad_requests_are_refused_by_name(scans):
    catalogue = Catalogue.build(scans[:2])
    wide = Scan.make(np.ones(400), angle_min=0.0, angle_increment=0.01, range_max=8.0)
    with pytest.raises(ValueError, match="400 beams are more than the catalogue's 192"):
        catalogue.add([wide])
    with pytest.raises(ValueError, match="likely: 0"):
        match_catalogue(scans[:1], catalogue, likely=0)
    with pytest.raises(ValueError, match="catalogue: it is empty"):
        match_catalogue(scans[:1], Catalogue(192, catalogue.config))
    with pytest.raises(ValueError, match="the list is empty"):
        Catalogue.build([])
