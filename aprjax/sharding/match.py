"""Matching with references on many devices: `aprjax.matcher` with a merge after every stage."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Bool, Float, Int

from aprjax.alignment.voting import Votes, VotingConfig, vote
from aprjax.batch import checked_config, checked_queries
from aprjax.calls import rows_of
from aprjax.configuration import Packed
from aprjax.features import Features, describe
from aprjax.matcher import MatchConfig, answer, evaluate, preselected, rank
from aprjax.numerics import single_precision
from aprjax.programs import compiler_options
from aprjax.references import ReferenceIndex, check_references
from aprjax.relations.histograms import preselection_quality
from aprjax.result import Counts, MatchResult
from aprjax.scan import Scan
from aprjax.sharding.references import ShardedReferences
from aprjax.shortlist import Looks, Shortlist, glances, keep, look, pass_on

_Tree = TypeVar("_Tree")


def match_sharded(
    scans: Sequence[Scan] | Scan,
    references: ShardedReferences,
    config: MatchConfig | None = None,
    *,
    exclude: np.ndarray | None = None,
) -> MatchResult:
    """Where each scan was taken, with respect to every reference on any device.

    `match_batch` for references that are spread: arguments, result and errors are the same, and
    the result lies on the host of every process. Compiles once for each bucket of beams, of
    references on a device, of queries and of ids to exclude. Raises `ValueError` also for a
    configuration without the cascade.
    """
    config, rules = checked_config(config)
    check_references(references, ShardedReferences)
    if not config.cascade:
        raise ValueError("cascade: references on several devices are matched by the cascade only")
    batch, excluded = checked_queries(scans, exclude)
    queries, devices = len(excluded), references.mesh.size
    chunk = min(config.chunk, 1 << (queries - 1).bit_length())
    chunk = -(-chunk // devices) * devices

    def work(start: int) -> MatchResult:
        rows = slice(start, start + chunk)
        ids = excluded[rows]
        return _program()(
            rows_of(batch, rows).pad_batch(chunk),
            np.pad(ids, [(0, chunk - len(ids)), (0, 0)], constant_values=-1),
            references.index,
            rules,
            references.mesh,
            together=references.mesh.devices.flat[0].platform != "cpu",
        )

    with single_precision():
        results = jax.device_get([work(start) for start in range(0, queries, chunk)])
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:queries], *results)


@cache
def _program() -> Callable[..., MatchResult]:
    """`_match_chunk`, jitted for the devices."""
    return jax.jit(
        _match_chunk,
        static_argnames=("mesh", "together"),
        compiler_options=compiler_options(),
    )


def _match_chunk(
    scans: Scan,
    excluded: Int[Array, "chunk any"],
    index: ReferenceIndex,
    rules: Packed[MatchConfig],
    mesh: Mesh,
    together: bool,
) -> MatchResult:
    """Queries, as many as there are devices or a multiple of it, with all references."""
    (axis,) = mesh.axis_names

    def on_a_device(
        scans: Scan, excluded: Array, index: ReferenceIndex, rules: Packed[MatchConfig]
    ) -> MatchResult:
        mine = jax.tree.map(lambda array: array[0], index)
        return _Device(mine, axis, mesh.size, together).match(scans, excluded, rules.config)

    everywhere, spread = PartitionSpec(), PartitionSpec(axis)
    results = jax.shard_map(
        on_a_device,
        mesh=mesh,
        in_specs=(everywhere, everywhere, spread, everywhere),
        out_specs=spread,
        check_vma=False,
    )(scans, excluded, index, rules)
    return jax.lax.with_sharding_constraint(results, NamedSharding(mesh, everywhere))


@dataclass(frozen=True)
class _Device:
    """What one device does, and what it exchanges with the others along the mesh's `axis`.

    Rows are numbered through all devices, except where they are said to be its own.
    """

    references: ReferenceIndex
    """Its own."""
    axis: str
    devices: int
    together: bool
    """Whether it works on all queries at once, or on one after the other."""

    def match(
        self, scans: Scan, excluded: Int[Array, "chunk any"], config: MatchConfig
    ) -> MatchResult:
        """Section 2 of the paper, as in `aprjax.matcher`; the results of its share of queries."""
        references, features = self.references, self.references.features
        raster_config, listing = references.config.raster, config.listing

        queries = jax.vmap(describe, (0, None))(self._share(scans), references.config)
        queries = self._gathered(queries)
        relation = references.config.relation
        q_m = preselection_quality(queries.histogram, features.histogram, relation)
        banned = jnp.any(references.ids[None, :, None] == excluded[:, None, :], axis=2)
        allowed = self._preselected(q_m, references.valid[None, :] & ~banned, config)

        def vote_one(query: Features, allowed: Bool[Array, " rows"]) -> Votes:
            k_m = features.histogram.edges
            return vote(references.edges, k_m, allowed, query.graph, config.voting)

        def glance_one(query: Features, votes: Votes) -> Float[Array, " poses"]:
            return glances(votes, features, query, raster_config, listing)

        def look_one(query: Features, passed: Votes) -> Looks:
            return look(passed, features, query, config.alignment, listing)

        def keep_one(passed: Votes, looks: Looks) -> Shortlist:
            return keep(passed, looks, config.alignment, listing)

        votes = self._merged(self._each(vote_one, queries, allowed), config.voting)
        score = self._owners(votes.row, self._each(glance_one, queries, self._own(votes)))
        passed = jax.vmap(lambda votes, score: pass_on(votes, score, listing))(votes, score)
        looks = self._owners(passed.row, self._each(look_one, queries, self._own(passed)))
        listed = jax.vmap(keep_one)(passed, looks)

        def finish(
            query: Features, votes: Votes, listed: Shortlist, near: ReferenceIndex, q_m: Array
        ) -> MatchResult:
            """The rest of one query, with copies of its listed references alone."""
            first = jnp.argmax(listed.row[:, None] == listed.row[None, :], axis=1)
            found = votes.found(self.devices * references.ids.shape[0])
            counts = Counts.of(query, found, listed)
            listed = eqx.tree_at(lambda those: those.row, listed, first)
            evaluated = evaluate(query, listed, near.features, config)
            ranked = rank(evaluated, near, config)
            return answer(query, q_m, evaluated, ranked, counts, near, config)

        near, q_m = self._fetched(listed.row, q_m)
        return self._each(finish, *self._share((queries, votes, listed)), near, q_m)

    def _each(self, function: Callable[..., _Tree], *of: Any) -> _Tree:
        """A function of one query, of all of them."""
        if self.together:
            return jax.vmap(function)(*of)
        return jax.lax.map(lambda arguments: function(*arguments), of)

    def _share(self, tree: _Tree) -> _Tree:
        """Its share of queries."""
        me = jax.lax.axis_index(self.axis)

        def mine(array: Array) -> Array:
            size = array.shape[0] // self.devices
            return jax.lax.dynamic_slice_in_dim(array, me * size, size)

        return jax.tree.map(mine, tree)

    def _gathered(self, tree: _Tree, along: int = 0) -> _Tree:
        """All devices' arrays one after the other, on each of them."""
        return jax.tree.map(
            lambda array: jax.lax.all_gather(array, self.axis, axis=along, tiled=True), tree
        )

    def _preselected(
        self,
        q_m: Float[Array, "chunk rows"],
        answering: Bool[Array, "chunk rows"],
        config: MatchConfig,
    ) -> Bool[Array, "chunk rows"]:
        """Those of its own references that are among the `top_k` of all."""
        if config.top_k is None:
            return answering
        q_m, answering = self._gathered((q_m, answering), along=1)
        allowed = jax.vmap(preselected, (0, 0, None))(q_m, answering, config)
        return self._share(allowed.T).T

    def _merged(self, votes: Votes, config: VotingConfig) -> Votes:
        """The best of all devices' votes, part by part; equals in the order of their rows."""
        chunk, size = votes.rating.shape
        places, poses = config.places, size // config.places
        offset = jax.lax.axis_index(self.axis) * self.references.ids.shape[0]
        votes = eqx.tree_at(lambda those: those.row, votes, votes.row + offset)
        votes = jax.tree.map(lambda a: a.reshape(chunk, places, poses, *a.shape[2:]), votes)
        votes = self._gathered(votes, along=2)
        _, best = jax.lax.top_k(votes.rating, min(config.poses, self.devices * poses))

        def take(array: Array) -> Array:
            index = best.reshape(*best.shape, *[1] * (array.ndim - 3))
            taken = jnp.take_along_axis(array, index, axis=2)
            return taken.reshape(chunk, -1, *array.shape[3:])

        return jax.tree.map(take, votes)

    def _place(self, row: Int[Array, "*at"]) -> tuple[Int[Array, "*at"], Bool[Array, "*at"]]:
        """Its own rows of these, 0 for those of others, and which are its own."""
        rows = self.references.ids.shape[0]
        own = row - jax.lax.axis_index(self.axis) * rows
        mine = (own >= 0) & (own < rows)
        return jnp.where(mine, own, 0), mine

    def _own(self, votes: Votes) -> Votes:
        """With its own rows, those of others being whatever."""
        return eqx.tree_at(lambda those: those.row, votes, self._place(votes.row)[0])

    def _owners(self, row: Int[Array, "chunk poses"], values: _Tree) -> _Tree:
        """Of values `(chunk, poses, ...)`, those of the device that has the row."""
        _, mine = self._place(row)
        return jax.lax.psum(_masked(values, mine), self.axis)

    def _fetched(
        self, row: Int[Array, "chunk kept"], q_m: Float[Array, "chunk rows"]
    ) -> tuple[ReferenceIndex, Float[Array, "share kept"]]:
        """Copies of the references that its share of queries needs, and their q_m.

        The index has leading axes of queries and references, but no edges of its own.
        """
        own, mine = self._place(row)

        def fetch(tree: _Tree) -> _Tree:
            def shared(array: Array) -> Array:
                number = array.astype(jnp.int32) if array.dtype == bool else array
                total = jax.lax.psum_scatter(number, self.axis, scatter_dimension=0, tiled=True)
                return total.astype(array.dtype)

            return jax.tree.map(shared, _masked(tree, mine))

        known = self.references
        features = known.features
        # All that is compared from here on are views and graphs.
        others = (
            features.anchors,
            features.histogram,
            features.raster,
            features.sketch,
            features.signature,
        )
        features = eqx.tree_at(
            lambda f: (f.anchors, f.histogram, f.raster, f.sketch, f.signature),
            features,
            jax.tree.map(lambda array: array[:, :0] if array.ndim > 1 else array, others),
        )
        share = row.shape[0] // self.devices
        features, ids, placement = fetch(
            jax.tree.map(lambda array: array[own], (features, known.ids, known.placement))
        )
        edges, described_by = jax.tree.map(
            lambda array: jnp.broadcast_to(array, (share, *array.shape)),
            (jax.tree.map(lambda array: array[..., :0], known.edges), known.described_by),
        )
        near = ReferenceIndex(features, edges, ids, placement, described_by)
        return near, fetch(jnp.take_along_axis(q_m, own, axis=1))


def _masked(tree: _Tree, mask: Bool[Array, "chunk any"]) -> _Tree:
    """Arrays `(chunk, any, ...)`, zero where not `mask`."""
    return jax.tree.map(
        lambda a: jnp.where(mask.reshape(*mask.shape, *[1] * (a.ndim - 2)), a, jnp.zeros_like(a)),
        tree,
    )
