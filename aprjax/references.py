"""The set of reference scans that queries are matched with."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Int

from aprjax.calls import rows_of
from aprjax.configuration import Packed, check_kind, check_single, shown
from aprjax.describing import described
from aprjax.evaluation.distinctiveness import Placement
from aprjax.features import FeatureConfig, Features
from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.grid.rendering import render
from aprjax.grid.viewpoints import viewpoints
from aprjax.numerics import bucket
from aprjax.relations.edge_table import EdgeTable
from aprjax.scan import Scan, as_stack


class ReferenceIndex(eqx.Module):
    """What the engine compares queries with: every reference's features, padded to a bucket."""

    features: Features
    """Leading axis `rows`."""
    edges: EdgeTable
    """Of all of them."""
    ids: Int[Array, " rows"]
    """Ascending; -1 in the padding at the end."""
    placement: Placement
    described_by: Packed[FeatureConfig]

    @property
    def config(self) -> FeatureConfig:
        """How scans are described; only in a program."""
        return self.described_by.config

    @property
    def valid(self) -> Bool[Array, " rows"]:
        """Rows that hold a reference."""
        return self.ids >= 0


FARTHEST = 1e8
"""Metres and radians from the origin, at most, of a reference: any map's frame, a globe's too."""


@dataclass(frozen=True, eq=False)
class ReferenceSet:
    """Reference scans with their features. Immutable: `add` and `remove` return another set.

    A reference keeps its id for good; an id is never given twice. Arrays grow in buckets of four
    to the octave, so that adding scans one by one compiles rarely.
    """

    scans: Scan
    """On the host, `(references, slots)`."""
    ids: np.ndarray
    """`(references,)`, ascending."""
    next_id: int
    """What the next reference will be called."""
    T_world_ref: np.ndarray
    """`(references, 3)`: poses in one frame of the user's, in metres and radians; NaN where not
    known."""
    config: FeatureConfig
    """How scans are described; on the host."""
    index: ReferenceIndex

    @classmethod
    def build(
        cls,
        scans: Sequence[Scan] | Scan,
        config: FeatureConfig | None = None,
        *,
        T_world_ref: np.ndarray | None = None,
    ) -> Self:
        """The set of these scans, with ids 0, 1, …

        `scans` is a list or a stacked `Scan` `(references, slots)`. A scan without anchors is
        kept and never matched. `T_world_ref` `(references, 3)`, metres and radians, are the poses
        of the lasers in one frame, for a user who has a metric map; they are not needed. Matching
        uses them to tell whether two answers mean the same place, and for nothing else. A row with
        a NaN is a pose that is not known. Raises `ValueError` if there is no scan, and for poses of
        another shape or beyond `FARTHEST`.
        """
        stacked = as_stack(scans)
        count = np.shape(stacked.ranges)[0]
        config = checked_features(config)
        return cls.restore(stacked, next_ids(0, count), count, config, T_world_ref)

    @classmethod
    def from_occupancy_grid(
        cls,
        grid: OccupancyGrid,
        config: FeatureConfig | None = None,
        *,
        like: Scan | None = None,
        distance: float = 2.0,
        clearance: float = 0.3,
        spacing: float = 0.5,
    ) -> Self:
        """The set of scans that a laser would take in a grid, at places that cover its free floor.

        `like` is one scan of the laser, of which beams and limits are taken; by default 360 beams
        look all around, up to 30 m. With a field of view that is no full turn, each place gets so
        many headings that every direction is seen from two. The lengths in metres are as in
        `grid.viewpoints`, which chooses the places: every place of the floor with `clearance` is
        within `distance` of a viewpoint that sees it. `T_world_ref` are the poses in the
        grid's world. The same set every time. Raises `ValueError` as `viewpoints` and `render` do.
        """
        if like is None:
            like = Scan.make(
                np.full(360, np.nan),
                angle_min=-np.pi,
                angle_increment=np.pi / 180,
                range_max=30.0,
            )
        xy = viewpoints(grid, distance=distance, clearance=clearance, spacing=spacing)
        field = float(abs(like.angle_increment)) * max(int(like.beams) - 1, 1)
        count = 1 if bool(like.full_turn) else int(np.ceil(4 * np.pi / field))
        headings = np.tile(2 * np.pi / count * np.arange(count), len(xy))
        T_world_ref = np.column_stack([np.repeat(xy, count, axis=0), headings])
        return cls.build(render(grid, T_world_ref, like), config, T_world_ref=T_world_ref)

    @classmethod
    def restore(
        cls,
        scans: Scan,
        ids: np.ndarray,
        next_id: int,
        config: FeatureConfig,
        T_world_ref: np.ndarray | None = None,
    ) -> Self:
        """The set of stacked `scans` under ascending `ids` `(references,)`, as a file holds it."""
        poses = checked_poses(T_world_ref, len(ids))
        scans, ids = jax.tree.map(np.array, (scans, ids))  # nobody else's, to stay as they are
        return cls._of(scans, ids, next_id, poses, described(scans, config), config)

    @classmethod
    def _of(
        cls,
        scans: Scan,
        ids: np.ndarray,
        next_id: int,
        T_world_ref: np.ndarray,
        features: Features,
        config: FeatureConfig,
    ) -> Self:
        """The set of scans whose features are known, on the host."""
        index = index_of(features, ids, T_world_ref - middle(T_world_ref), config)
        return cls(scans, ids, next_id, T_world_ref, config, jax.device_put(index))

    def __len__(self) -> int:
        return len(self.ids)

    def add(self, scans: Sequence[Scan] | Scan, *, T_world_ref: np.ndarray | None = None) -> Self:
        """The set with these scans added under the next ids; only they are described anew.

        But for one with more beams than the scans of the set have slots: then all are, and matching
        compiles anew. `T_world_ref` as in `build`, for the added scans.
        """
        there, new = equally_wide(self.scans, as_stack(scans))
        count = new.ranges.shape[0]
        both = joined(there, new)
        if there.ranges.shape == self.scans.ranges.shape:
            features = joined(self._features(), described(new, self.config))
        else:  # views are as wide as the scans
            features = described(both, self.config)
        ids = np.r_[self.ids, next_ids(self.next_id, count)]
        poses = np.concatenate([self.T_world_ref, checked_poses(T_world_ref, count)])
        return self._of(both, ids, self.next_id + count, poses, features, self.config)

    def remove(self, ids: Iterable[int]) -> Self:
        """The set without the references of these ids; the others keep theirs.

        Raises `ValueError` naming an id that is not in the set.
        """
        keep = remaining(self.ids, ids)
        return self._of(
            rows_of(self.scans, keep),
            self.ids[keep],
            self.next_id,
            self.T_world_ref[keep],
            rows_of(self._features(), keep),
            self.config,
        )

    def _features(self) -> Features:
        """The features without padding, on the host."""
        return rows_of(self.index.features, slice(len(self.ids)))


def checked_features(config: FeatureConfig | None) -> FeatureConfig:
    """The configuration or the defaults.

    Raises `ValueError` for one of another kind, and naming a threshold that is several numbers.
    """
    if config is None:
        return FeatureConfig()
    check_kind("config", config, FeatureConfig)
    check_single(config)
    return config


def check_references(references: Any, kind: type) -> None:
    """Raise `ValueError` unless these are references of that kind, and some."""
    check_kind("references", references, kind)
    if len(references) == 0:
        raise ValueError("references: the set is empty")


def next_ids(next_id: int, count: int) -> np.ndarray:
    """The ids of `count` further references; raises `ValueError` where int32 has no more."""
    if next_id + count > np.iinfo(np.int32).max:
        raise ValueError(f"scans: there are no ids for {count} after {next_id - 1}")
    return np.arange(next_id, next_id + count, dtype=np.int32)


def remaining(ids: np.ndarray, gone: Iterable[int]) -> np.ndarray:
    """Which of `ids` are not `gone` `(references,)`; raises `ValueError` for one not there."""
    leaving = checked_ids("ids", list(gone))
    wrong = np.flatnonzero(~np.isin(leaving, ids))
    if wrong.size:
        raise ValueError(f"ids[{wrong[0]}]: no reference has id {leaving[wrong[0]]}")
    return ~np.isin(ids, leaving)


def checked_ids(name: str, ids: Any) -> np.ndarray:
    """Ids of any whole numbers as int32; raises `ValueError` naming what can be none."""
    try:
        given = np.asarray(ids)
    except ValueError:
        raise ValueError(f"{name}: rows of several lengths are no array of ids") from None
    if given.size == 0:
        return np.empty(given.shape, np.int32)
    if given.dtype == object:  # whole numbers that int64 cannot hold, or no numbers at all
        fits = [isinstance(each, int) and -(1 << 31) <= each < 1 << 31 for each in given.flat]
        kept, right = given, np.array(fits).reshape(given.shape)
    elif np.issubdtype(given.dtype, np.integer):
        kept = given.astype(np.int32)
        right = kept == given
    else:
        raise ValueError(f"{name}: {given.dtype} is no type of ids")
    wrong = np.argwhere(~right)
    if len(wrong):
        at = f"[{', '.join(map(str, wrong[0]))}]" if given.ndim else ""
        raise ValueError(f"{name}{at}: {shown(given[tuple(wrong[0])])} is no id")
    return kept.astype(np.int32, copy=False)


def equally_wide(there: Scan, new: Scan) -> tuple[Scan, Scan]:
    """Both stacks on the host, as wide as `there` where the beams of `new` fit into that."""
    slots = there.ranges.shape[-1]
    if np.max(new.beams) > slots:
        slots = max(slots, new.ranges.shape[-1])
    else:  # what is cut off is padding
        new = eqx.tree_at(lambda scans: scans.ranges, new, np.asarray(new.ranges)[:, :slots])
    return there.pad(slots), new.pad(slots)


def joined(first, second):
    """Two stacks of scans or features on the host, one after the other."""
    return jax.tree.map(lambda a, b: np.concatenate([a, b]), first, second)


def checked_poses(T_world_ref: np.ndarray | None, count: int) -> np.ndarray:
    """Checked poses `(count, 3)`, NaN where none are given."""
    if T_world_ref is None:
        return np.full((count, 3), np.nan)
    try:
        poses = np.array(T_world_ref, float)
    except (TypeError, ValueError):
        raise ValueError("T_world_ref: it is no array of numbers") from None
    if poses.shape != (count, 3):
        raise ValueError(f"T_world_ref: shape {poses.shape} is not ({count}, 3)")
    far = np.flatnonzero((np.abs(poses) > FARTHEST).any(axis=1))
    if far.size:
        problem = (
            "finite" if np.isinf(poses[far[0]]).any() else f"within {FARTHEST:g} of the origin"
        )
        raise ValueError(f"T_world_ref[{far[0]}]: {poses[far[0]]} is not {problem}")
    return poses


def middle(T_world_ref: np.ndarray) -> np.ndarray:
    """What to take from poses `(references, 3)`, some of them NaN, so that the origin is amid them.

    Only differences matter, and float32 is too coarse for coordinates far from their origin.
    """
    known = np.all(np.isfinite(T_world_ref), axis=1)
    return np.append(T_world_ref[known, :2].mean(axis=0) if known.any() else np.zeros(2), 0.0)


def index_of(
    features: Features,
    ids: np.ndarray,
    T_world_ref: np.ndarray,
    config: FeatureConfig,
    rows: int | None = None,
) -> ReferenceIndex:
    """The index of unpadded features, on the host, with so many rows or those of its bucket.

    `T_world_ref` are poses around the origin (see `middle`). Raises `ValueError` for more than
    32 bits can number the raster cells of.
    """
    rows = bucket(max(len(ids), 1)) if rows is None else rows
    most = np.iinfo(np.int32).max // config.raster.size**2
    if rows > most:
        raise ValueError(f"references: {len(ids)} of them are more than a set can hold, {most}")

    def pad(array: np.ndarray, fill: int = 0) -> Any:
        width = [(0, rows - len(ids))] + [(0, 0)] * (array.ndim - 1)
        return np.pad(array, width, constant_values=fill)

    padded = jax.tree.map(pad, features)
    # A step of zero between beams would divide by zero.
    step = pad(np.asarray(features.view.angle_increment), fill=1)
    padded = eqx.tree_at(
        lambda f: (f.view.angle_increment, f.sketch.scanner.angle_increment), padded, (step, step)
    )
    known = np.all(np.isfinite(T_world_ref), axis=1)
    poses = np.where(known[:, None], T_world_ref, 0.0).astype(np.float32)
    placement = Placement(pad(poses), pad(known))
    edges = EdgeTable.build(padded.graph)
    return ReferenceIndex(padded, edges, pad(ids, fill=-1), placement, Packed.of(config))
