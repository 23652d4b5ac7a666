import jax
import numpy as np
import pytest

from aprjax.features import FeatureConfig
from aprjax.numerics import bucket
from aprjax.references import ReferenceSet, index_of
from aprjax.scan import Scan
from tests.worlds import free_pose, office, scan_at


@pytest.fixture(scope="module")
def scans():
    rng = np.random.default_rng(5)
    world = office(seed=3)
    return [scan_at(world, free_pose(world, rng), noise=0.01, rng=rng) for _ in range(12)]


@pytest.fixture(scope="module")
def references(scans):
    return ReferenceSet.build(scans)


def features(references):
    """The features of the references proper, as NumPy arrays."""
    return jax.tree.map(lambda a: np.asarray(a)[: len(references)], references.index.features)


def assert_same(first, second):
    """The same references, described alike."""
    np.testing.assert_array_equal(first.ids, second.ids)
    np.testing.assert_array_equal(first.index.ids, second.index.ids)
    for tree in (lambda r: r.scans, features):
        one, other = jax.tree.leaves(tree(first)), jax.tree.leaves(tree(second))
        for a, b in zip(one, other, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-5)


def test_ids_count_from_zero_in_the_order_of_the_scans(references, scans):
    assert len(references) == len(scans) == references.next_id
    np.testing.assert_array_equal(references.ids, np.arange(len(scans)))
    np.testing.assert_array_equal(references.scans.ranges[3, :181], scans[3].ranges)


def test_a_stacked_scan_builds_the_same_set_as_a_list(references, scans):
    assert_same(ReferenceSet.build(Scan.stack(scans)), references)


def test_rows_beyond_the_references_are_not_valid(references):
    rows = bucket(len(references))
    fewer = references.remove([4])
    for each in (references, fewer):
        assert each.index.ids.shape == (rows,)
        np.testing.assert_array_equal(each.index.valid, np.arange(rows) < len(each))
        np.testing.assert_array_equal(each.index.ids[len(each) :], -1)
        for leaf in jax.tree.leaves(each.index.features):
            assert leaf.shape[0] == rows


@pytest.mark.parametrize(("count", "rows"), [(1, 8), (8, 8), (9, 10), (33, 40), (65, 80)])
def test_rows_grow_in_buckets(scans, count, rows):
    built = ReferenceSet.build([scans[i % len(scans)] for i in range(count)])
    assert len(built) == count
    assert built.index.ids.shape == (rows,)


def test_scans_are_described_alike_wherever_they_stand(scans, references, monkeypatch):
    """More than two chunks of references, the last one padded, each scan many times."""
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    many = features(ReferenceSet.build([scans[i % len(scans)] for i in range(70)]))
    few = features(references)
    for a, b in zip(jax.tree.leaves(many), jax.tree.leaves(few), strict=True):
        np.testing.assert_allclose(a, b[np.arange(70) % len(scans)], rtol=1e-5, atol=1e-5)


def test_added_scans_are_as_if_built_with_the_others(scans, references):
    start = ReferenceSet.build(scans[:5])
    assert_same(start.add(scans[5:9]).add(scans[9:]), references)
    assert len(start) == 5


def test_ids_that_int32_cannot_hold_are_not_given(references, scans):
    last = np.iinfo(np.int32).max - 1
    nearly = ReferenceSet.restore(references.scans, references.ids, last, FeatureConfig())
    assert nearly.add(scans[:1]).ids[-1] == last
    with pytest.raises(ValueError, match=rf"^scans: there are no ids for 2 after {last - 1}$"):
        nearly.add(scans[:2])


def test_more_references_than_their_raster_cells_can_be_numbered_are_refused(references):
    features = references._features()
    with pytest.raises(ValueError, match=r"^references: .* more than a set can hold, 233016$"):
        index_of(features, references.ids, references.T_world_ref, FeatureConfig(), 233017)


def test_added_scans_may_have_more_beams_than_those_there(scans):
    rng = np.random.default_rng(6)
    world = office(seed=3)
    wide = scan_at(world, free_pose(world, rng), beams=241)
    assert_same(ReferenceSet.build(scans[:3]).add([wide]), ReferenceSet.build([*scans[:3], wide]))


def test_scans_of_as_many_beams_are_added_to_a_stack_without_describing_the_others_anew(scans):
    """A list is padded to a bucket, a stack is taken as it is."""
    rows = [scan.ranges for scan in scans[:3]]
    fields = {name: getattr(Scan.stack(scans[:3]), name) for name in Scan.__dataclass_fields__}
    start = ReferenceSet.build(Scan(**fields | {"ranges": np.stack(rows)}))
    added = start.add(scans[3:5])
    assert added.scans.ranges.shape == (5, 181)
    for a, b in zip(*map(jax.tree.leaves, (features(added), features(start))), strict=True):
        np.testing.assert_array_equal(a[:3], b)
    np.testing.assert_array_equal(added.scans.ranges[3:], [scan.ranges for scan in scans[3:5]])
    assert_same(added.add([scans[5].pad(300)]), start.add(scans[3:6]))


def test_what_a_set_was_built_from_may_change_and_the_set_does_not(scans):
    stack, poses = Scan.stack(scans[:3]), np.zeros((3, 3))
    built = ReferenceSet.build(stack, T_world_ref=poses)
    kept = jax.tree.map(np.copy, (built.scans, built.T_world_ref))
    for array in (*jax.tree.leaves(stack), poses):
        array[:] = 7
    for ours, wanted in zip(
        *map(jax.tree.leaves, ((built.scans, built.T_world_ref), kept)), strict=True
    ):
        np.testing.assert_array_equal(ours, wanted)
    on_device = ReferenceSet.build(jax.device_put(Scan.stack(scans[:3])))
    assert all(type(leaf) is np.ndarray for leaf in jax.tree.leaves(on_device.scans))


def test_removed_ids_are_gone_and_the_others_keep_theirs(references):
    fewer = references.remove([3, 0])
    assert len(fewer) == len(references) - 2
    np.testing.assert_array_equal(fewer.ids, [i for i in range(12) if i not in (0, 3)])
    kept = jax.tree.leaves(features(fewer))
    for a, b in zip(kept, jax.tree.leaves(features(references)), strict=True):
        np.testing.assert_array_equal(a, b[fewer.ids])
    assert len(references) == 12


def test_an_id_is_never_given_twice(references, scans):
    again = references.remove([11]).add([scans[11]])
    np.testing.assert_array_equal(again.ids, [*range(11), 12])
    assert again.next_id == 13


def test_removing_an_unknown_id_is_refused_by_name(references):
    with pytest.raises(ValueError, match=r"ids\[1\].*99"):
        references.remove([0, 99])
    with pytest.raises(ValueError, match=r"ids\[0\].*-1"):
        references.remove([-1])
    with pytest.raises(ValueError, match=r"ids\[0\].*3"):
        references.remove([3]).remove([3])


def test_everything_can_be_removed_and_something_added_again(references, scans):
    empty = references.remove(range(12))
    assert len(empty) == 0
    assert not np.any(empty.index.valid)
    again = empty.add(scans[:1])
    np.testing.assert_array_equal(again.ids, [12])


def test_a_set_is_restored_from_its_scans_and_ids(references):
    fewer = references.remove([1, 5])
    restored = ReferenceSet.restore(fewer.scans, fewer.ids, fewer.next_id, FeatureConfig())
    assert_same(restored, fewer)
    assert restored.next_id == 12


def test_a_scan_without_anchors_is_kept(scans):
    blank = Scan.make(
        np.full(181, np.nan), angle_min=-np.pi / 2, angle_increment=np.pi / 180, range_max=30.0
    )
    built = ReferenceSet.build([scans[0], blank, scans[1]])
    assert len(built) == 3
    assert not np.any(built.index.features.anchors.valid[1])
    for leaf in jax.tree.leaves(features(built)):
        assert np.all(np.isfinite(leaf) | (leaf == np.inf))


def test_no_scans_are_refused(references):
    with pytest.raises(ValueError, match="empty"):
        ReferenceSet.build([])
    with pytest.raises(ValueError, match="empty"):
        references.add([])


def test_scans_of_the_wrong_rank_are_refused(references, scans):
    with pytest.raises(ValueError, match=r"\(181,\)"):
        ReferenceSet.build(scans[0])
    with pytest.raises(ValueError, match=r"scans\[1\]"):
        ReferenceSet.build([scans[0], references.scans])


def poses_of(references):
    """The poses that matching uses, of the references proper, from the first one's position.

    NaN where not known.
    """
    placement = jax.device_get(references.index.placement)
    known = np.where(placement.known[:, None], placement.T_world_ref, np.nan)
    assert np.isnan(known[len(references) :]).all()
    return known[: len(references)] - np.append(known[0, :2], 0.0)


def test_poses_stay_with_their_references(scans):
    far = [5.0e5, 5.4e6, 0.0]  # coordinates of a national grid
    poses = np.random.default_rng(0).uniform(-3, 3, (12, 3)) + far
    built = ReferenceSet.build(scans[:8], T_world_ref=poses[:8])
    unknown = np.full((1, 3), np.nan)
    changed = built.remove([2]).add(scans[8:9]).add(scans[9:], T_world_ref=poses[9:])
    expected = np.concatenate([poses[:2], poses[3:8], unknown, poses[9:]])
    np.testing.assert_array_equal(changed.T_world_ref, expected)
    from_first = expected - np.append(expected[0, :2], 0.0)
    np.testing.assert_allclose(poses_of(changed), from_first, atol=1e-5)


def test_without_poses_none_is_known(references):
    assert np.isnan(poses_of(references)).all()


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (np.zeros((11, 3)), r"T_world_ref: shape \(11, 3\) is not \(12, 3\)"),
        (np.zeros((12, 2)), r"T_world_ref: shape \(12, 2\) is not \(12, 3\)"),
        (np.where(np.arange(36).reshape(12, 3) == 7, np.inf, 0), r"T_world_ref\[2\]: .*inf"),
        (
            np.where(np.arange(36).reshape(12, 3) == 8, -1e9, 0),
            r"T_world_ref\[2\]: .* within 1e\+08",
        ),
        ([["a", 0, 0]], "T_world_ref: it is no array of numbers"),
    ],
)
def test_poses_that_fit_no_references_are_refused(scans, poses, message):
    with pytest.raises(ValueError, match=message):
        ReferenceSet.build(scans, T_world_ref=poses)
