"""The set of reference scans, spread over devices."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array

from aprjax.calls import rows_of
from aprjax.describing import described
from aprjax.features import FeatureConfig
from aprjax.numerics import bucket
from aprjax.references import (
    ReferenceIndex,
    checked_features,
    checked_poses,
    equally_wide,
    index_of,
    joined,
    middle,
    next_ids,
    remaining,
)
from aprjax.scan import Scan, as_stack


@dataclass(frozen=True, eq=False)
class ShardedReferences:
    """Reference scans and their features, spread evenly over the devices of a mesh.

    As `ReferenceSet`, but `add` and `remove` spread, and describe, all of them anew: references
    that change often are better kept in a `ReferenceSet` for as long as it holds them.
    """

    scans: Scan
    """On the host, `(references, slots)`."""
    ids: np.ndarray
    """`(references,)`, ascending."""
    next_id: int
    """What the next reference will be called."""
    T_world_ref: np.ndarray
    """`(references, 3)`, metres and radians; NaN where not known."""
    config: FeatureConfig
    mesh: Mesh
    """Of one axis."""
    index: ReferenceIndex
    """Every leaf has a leading axis of devices, along which it is spread."""

    @classmethod
    def build(
        cls,
        scans: Sequence[Scan] | Scan,
        mesh: Mesh,
        config: FeatureConfig | None = None,
        *,
        T_world_ref: np.ndarray | None = None,
    ) -> Self:
        """The set of these scans, with ids 0, 1, …, on all devices of the mesh.

        Arguments and errors are those of `ReferenceSet.build`; `ValueError` also for a mesh of
        several axes, or of more devices than there are scans. The devices of a process are to be
        neighbours in the mesh, as they are in `jax.devices()`.
        """
        # Nobody else's, to stay as they are.
        stacked = jax.tree.map(np.array, as_stack(scans))
        count = np.shape(stacked.ranges)[0]
        poses = checked_poses(T_world_ref, count)
        config = checked_features(config)
        return cls._spread(stacked, next_ids(0, count), count, poses, config, mesh)

    @classmethod
    def _spread(
        cls,
        scans: Scan,
        ids: np.ndarray,
        next_id: int,
        T_world_ref: np.ndarray,
        config: FeatureConfig,
        mesh: Mesh,
    ) -> Self:
        """As many references on each device, in the order of their ids."""
        if len(mesh.axis_names) != 1:
            raise ValueError(f"mesh: axes {mesh.axis_names} are not one")
        if len(ids) < mesh.size:
            raise ValueError(f"scans: {len(ids)} of them are fewer than the {mesh.size} devices")
        bounds = np.linspace(0, len(ids), mesh.size + 1).astype(int)
        rows = bucket(int(np.diff(bounds).max()))
        origin = middle(T_world_ref)

        def shard(number: int) -> ReferenceIndex:
            here = slice(bounds[number], bounds[number + 1])
            features = described(rows_of(scans, here), config)
            return index_of(features, ids[here], T_world_ref[here] - origin, config, rows)

        process = jax.process_index()
        mine = [k for k, device in enumerate(mesh.devices.flat) if device.process_index == process]
        if not mine or mine != list(range(mine[0], mine[-1] + 1)):
            raise ValueError(f"mesh: the devices of process {process} are not neighbours in it")

        def placed(*shards: np.ndarray) -> Array:
            """One leaf of the index, of which these are the parts in this process."""
            layout = NamedSharding(mesh, PartitionSpec(*mesh.axis_names))
            return jax.make_array_from_process_local_data(layout, np.stack(shards))

        index = jax.tree.map(placed, *map(shard, mine))
        return cls(scans, ids, next_id, T_world_ref, config, mesh, index)

    def __len__(self) -> int:
        return len(self.ids)

    def add(self, scans: Sequence[Scan] | Scan, *, T_world_ref: np.ndarray | None = None) -> Self:
        """The set with these scans added under the next ids, spread anew. Raises as `build`."""
        there, new = equally_wide(self.scans, as_stack(scans))
        count = np.shape(new.ranges)[0]
        return self._spread(
            joined(there, new),
            np.r_[self.ids, next_ids(self.next_id, count)],
            self.next_id + count,
            np.concatenate([self.T_world_ref, checked_poses(T_world_ref, count)]),
            self.config,
            self.mesh,
        )

    def remove(self, ids: Iterable[int]) -> Self:
        """The set without the references of these ids, spread anew; the others keep theirs.

        Raises `ValueError` naming an id that is not in the set, and if fewer references than
        devices would be left.
        """
        left = remaining(self.ids, ids)
        return self._spread(
            rows_of(self.scans, left),
            self.ids[left],
            self.next_id,
            self.T_world_ref[left],
            self.config,
            self.mesh,
        )
