"""Poses that many corresponding edges agree on, over all references at once (paper 2.B, 2.C).

Every pair of an edge of the query and an edge of a reference of about the same length gives two
transformations. The paper thins the pairs out before it computes any: references by q_m, rotations
by the peaks of the matching angle histogram, identifications by the correspondence matrix. Here
each pair votes at once for its cells of (reference, rotation, place), a generalised Hough
transform (Ballard, Pattern Recognition 13, 1981); the table keeps the pairs few. A cell is rated
as the paper rates a reference, by c² / (k_act k_m), but only correspondences that agree on the
pose are counted. `aprjax.alignment.align` is the paper's own way; the README says what either
finds, and what it costs.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.numerics import in_turn, take, wrap
from aprjax.relations.edge_table import EdgeTable, Geometry
from aprjax.relations.graph import AnchorGraph
from aprjax.se2 import Pose, rotate


class VotingConfig(eqx.Module):
    """When edges correspond, and how finely their votes are counted."""

    length: Float[Array, ""] = threshold(0.1, "metres that corresponding lengths may differ by")
    cell: Float[Array, ""] = threshold(0.6, "metres: side of a cell", least=0.001)
    directions: int = capacity(40, "cells of rotation over a full turn; an even number")
    grids: int = capacity(2, "grids of cells, shifted so that no pose is at the border of all")
    places: int = capacity(32, "parts of a reference's cells, of each of which the best is kept")
    depth: int = capacity(32, "counters of a part, which its cells are hashed to")
    poses: int = capacity(64, "poses kept of each part, over all references")

    def __check_init__(self) -> None:
        for name in ("places", "depth"):
            if getattr(self, name).bit_count() != 1:
                raise ValueError(f"{name}: {getattr(self, name)} is not a power of two")
        if self.directions % 2:
            raise ValueError(f"directions: {self.directions} is not an even number of cells")


class Votes(eqx.Module):
    """Poses, those of each part together; best rated first, where not all of them are kept."""

    T_ref_query: Pose
    """Metres and radians: that of the longest of the agreeing edges."""
    row: Int[Array, " poses"]
    """The reference."""
    count: Int[Array, " poses"]
    """c: correspondences that agree on the pose."""
    rating: Float[Array, " poses"]
    """c / √(k_act k_m)."""
    valid: Bool[Array, " poses"]

    def found(self, rows: int) -> Int[Array, " rows"]:
        """How many are in each reference."""
        return jnp.zeros(rows, jnp.int32).at[self.row].add(self.valid.astype(jnp.int32))


class _Edge(NamedTuple):
    """Undirected edges of the query, less their length."""

    cos: Float[Array, "*k"]
    sin: Float[Array, "*k"]
    direction: Float[Array, "*k"]
    """Radians in [0, π]."""
    arm_x: Float[Array, "*k"]
    """From the middle of the edge to the centre of the query's anchors, in metres."""
    arm_y: Float[Array, "*k"]


class _Turned(eqx.Module):
    """Where corresponding edges put the query's centre in metres, and how they turn it (rad)."""

    x: Float[Array, "*pairs"]
    y: Float[Array, "*pairs"]
    turn: Float[Array, "*pairs"]


def vote(
    table: EdgeTable,
    k_m: Float[Array, " rows"],
    allowed: Bool[Array, " rows"],
    query: AnchorGraph,
    config: VotingConfig,
) -> Votes:
    """The best rated poses of one query in the `allowed` references; `k_m` counts their edges.

    A reference's cells are divided at random into `places` parts, and of each part the best
    `poses` of all references are kept: next to the best of all, at a fraction of the time. Equals
    are in the order of their rows; counts being small, the last that are kept mostly have equals
    that are not, in references of higher rows. The query has as many slots for anchors as the
    references have.
    """
    rows = k_m.shape[0]
    centre = _centre(query)
    length, edges = _edges(query, centre)
    begin, end = table.windows(length, config.length)
    end = jnp.where(jnp.arange(length.shape[0]) < query.edges, end, begin)
    blocks, slots = table.length.shape
    height = -(-rows // blocks)  # as `blocks_of` has it

    def one(of: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        return _best_of_block(*of, table, edges, height, config)

    count, pair = jax.lax.map(one, (jnp.arange(blocks, dtype=jnp.int32), begin, end))
    count, pair = count.reshape(-1), pair.reshape(-1)

    pairs = k_m * jnp.maximum(query.edges.astype(jnp.float32), 1.0)
    weight = jnp.where(allowed, jax.lax.rsqrt(jnp.maximum(pairs, 1.0)), 0.0)
    votes = count.astype(jnp.float32).reshape(-1, config.grids, config.places)[:rows]
    rating = (votes * weight[:, None, None]).reshape(-1, config.places).T
    if rating.shape[1] > config.poses:
        rating, row = jax.lax.top_k(rating, config.poses)
    else:  # to sort them would take a single query nearly as long as to count the votes
        row = jnp.broadcast_to(jnp.arange(rating.shape[1], dtype=jnp.int32), rating.shape)
    place = (row * config.places + jnp.arange(config.places)[:, None]).reshape(-1)
    rating, row = rating.reshape(-1), row.reshape(-1) // config.grids
    pair = jnp.maximum(pair[place], 0)
    at = row // height * slots + pair // 2 % slots
    T_ref_query = _pose(table, at, edges, pair // 2 // slots, pair % 2, centre)
    return Votes(
        T_ref_query=jnp.where((rating > 0)[:, None], T_ref_query, 0.0),
        row=row,
        count=count[place],
        rating=rating,
        valid=rating > 0,
    )


def _best_of_block(
    block: Int[Array, ""],
    begin: Int[Array, " k"],
    end: Int[Array, " k"],
    table: EdgeTable,
    edges: Float[Array, "fields k"],
    height: int,
    config: VotingConfig,
) -> tuple[Int[Array, " parts"], Int[Array, " parts"]]:
    """Of each part of the cells of a block's `height` references: the most votes of a counter, and
    which pair of edges, the longest that voted there; -1 where none did.

    Slots `begin` to `end` of the block correspond to each edge of the query. A pair's number is
    2 (k slots + slot) for edge k of the query, and one more in the other sense.
    """
    slots, grids = table.length.shape[1], range(config.grids)
    # Runs of slots, edge after edge of the query; so many belong to the edges up to each.
    mine = (end - begin + _RUN - 1) // _RUN
    upto = jnp.cumsum(mine)
    geometry, rows = table.geometry.reshape(len(Geometry._fields), -1), table.row.reshape(-1)

    def load(round_: Int[Array, ""]) -> tuple[Array, Array, Array, Array, Array]:
        """The pairs of a few runs: both edges, the row, the number, and whether they are real."""
        run = round_ * _RUNS + jnp.arange(_RUNS, dtype=jnp.int32)
        k = jnp.sum(upto[None, :] <= run[:, None], axis=1, dtype=jnp.int32)
        k = jnp.minimum(k, mine.shape[0] - 1)
        start = begin[k] + (run - (upto[k] - mine[k])) * _RUN
        end_ = jnp.where(run < upto[-1], end[k], 0)
        place = jnp.arange(_RUNS * _RUN, dtype=jnp.int32)
        k, start, end_ = (jnp.repeat(each, _RUN) for each in (k, start, end_))
        slot = jnp.clip(start + place % _RUN, 0, slots - 1)
        at = block * slots + slot
        return (
            take(edges, k),
            take(geometry, at),
            take(rows, at),
            2 * (k * slots + slot),
            slot < end_,
        )

    def count(pairs: tuple[Array, ...], boards: tuple[Array, Array]) -> tuple[Array, Array]:
        """The votes of these pairs."""
        counters, longest = boards
        ours, theirs, row, number, real = pairs
        one = real.astype(counters.dtype)
        for sense, T in enumerate(_either_sense(_Edge(*ours), Geometry(*theirs))):
            pair = jnp.where(real, number + sense, -1)
            for grid in grids:
                cell = _counter(T, row, grid, height, config)
                counters = counters.at[cell].add(one, mode=_IN_BOUNDS)
                longest = longest.at[cell].max(pair, mode=_IN_BOUNDS)
        return counters, longest

    parts = height * config.grids * config.places
    width = jnp.int16 if edges.shape[1] <= _NARROW else jnp.int32
    boards = jnp.zeros(config.depth * parts, width), jnp.full(config.depth * parts, -1, jnp.int32)
    rounds = (upto[-1] + _RUNS - 1) // _RUNS
    counters, longest = in_turn(rounds, load, count, boards)

    # Count and counter in one integer make this a plain maximum, which XLA vectorises.
    counters = counters.reshape(config.depth, parts).astype(jnp.int32)
    level = jnp.arange(config.depth, dtype=jnp.int32)[:, None]
    best = jnp.max(counters * config.depth + level, axis=0)
    winner = best % config.depth * parts + jnp.arange(parts, dtype=jnp.int32)
    return best // config.depth, longest.at[winner].get(mode=_IN_BOUNDS)


_IN_BOUNDS = "promise_in_bounds"
_RUN, _RUNS = 16, 128
"""Slots of the table in a run, and runs that vote in one round."""
_NARROW = 64 * 63 // 2
"""Most edges of a query whose votes are counted in 16 bits, those of 64 anchors.

A cell's count grows with the edges of either graph, and these with the square of the anchors: 128
at random in 4 m x 4 m, matched with themselves, gave one cell 38 311 votes, which 16 bits do not
hold; 64 gave 4 240, and on a lattice of 0.25 m, as close as anchors may be, 15 375.
"""


def _centre(query: AnchorGraph) -> Float[Array, "2"]:
    """The middle of the query's anchors, which a wrong rotation moves least."""
    real = jnp.any(query.valid, axis=1).astype(jnp.float32)
    weight = real / jnp.maximum(jnp.sum(real), 1.0)
    return jnp.sum(weight[:, None] * query.xy, axis=0)


def _edges(
    query: AnchorGraph, centre: Float[Array, "2"]
) -> tuple[Float[Array, " k"], Float[Array, "fields k"]]:
    """The query's edges in ascending order, so that the last to vote has the best rotation.

    Their lengths in metres, and what `_Edge` names; those that are none come at the end.
    """
    a, b = np.triu_indices(query.xy.shape[0], k=1)
    valid = query.valid[a, b]
    order = jnp.argsort(jnp.where(valid, query.length[a, b], jnp.inf))
    a, b = jnp.asarray(a)[order], jnp.asarray(b)[order]
    unit = query.unit[a, b]
    cos, sin = jnp.where(unit[:, 1:] < 0, -unit, unit).T
    direction = jnp.arctan2(sin, jnp.where(valid[order], cos, 1.0))
    arm = centre[None, :] - 0.5 * (query.xy[a] + query.xy[b])
    return query.length[a, b], jnp.stack(_Edge(cos, sin, direction, arm[:, 0], arm[:, 1]))


def _either_sense(ours: _Edge, theirs: Geometry) -> tuple[_Turned, _Turned]:
    """Edges of the query on edges of the table, middle on middle, and the other way round."""
    cos = theirs.cos * ours.cos + theirs.sin * ours.sin
    sin = theirs.sin * ours.cos - theirs.cos * ours.sin
    dx, dy = cos * ours.arm_x - sin * ours.arm_y, sin * ours.arm_x + cos * ours.arm_y
    turn = theirs.direction - ours.direction
    return (
        _Turned(theirs.x + dx, theirs.y + dy, turn),
        _Turned(theirs.x - dx, theirs.y - dy, turn + np.float32(np.pi)),
    )


def _counter(
    T: _Turned, row: Int[Array, " edges"], grid: int, rows: int, config: VotingConfig
) -> Int[Array, " edges"]:
    """The counter of each cell: a multiplicative hash with two xor-shifts.

    Places are the last axis, so that their maxima over the depth are taken many at a time.
    """
    shift = grid / config.grids
    direction = T.turn * (config.directions / (2 * np.pi)) + shift
    direction = jnp.floor(direction).astype(jnp.int32)
    direction = jnp.where(direction < 0, direction + config.directions, direction)
    direction = jnp.where(direction >= config.directions, direction - config.directions, direction)
    x, y = (jnp.floor(along / config.cell + shift).astype(jnp.int32) for along in (T.x, T.y))
    mixed = jnp.uint32(0)
    for number, factor in ((direction, 0x9E3779B1), (x, 0x27D4EB2F), (y, 0x165667B1)):
        mixed = mixed + number.astype(jnp.uint32) * np.uint32(factor)
    mixed = (mixed ^ (mixed >> np.uint32(15))) * np.uint32(0x045D9F3B)
    mixed = mixed ^ (mixed >> np.uint32(16))
    place = (mixed % np.uint32(config.places)).astype(jnp.int32)
    level = (mixed // np.uint32(config.places) % np.uint32(config.depth)).astype(jnp.int32)
    return ((level * rows + row) * config.grids + grid) * config.places + place


def _pose(
    table: EdgeTable,
    at: Int[Array, " poses"],
    edges: Float[Array, "fields k"],
    k: Int[Array, " poses"],
    sense: Int[Array, " poses"],
    centre: Float[Array, "2"],
) -> Pose:
    """T_ref_query that lays the query's edges `k` on those at places of the whole table."""
    theirs = take(table.geometry.reshape(len(Geometry._fields), -1), at)
    T = jax.tree.map(
        lambda along, against: jnp.where(sense == 0, along, against),
        *_either_sense(_Edge(*take(edges, k)), Geometry(*theirs)),
    )
    turned = rotate(jnp.broadcast_to(centre, (*at.shape, 2)), T.turn)
    return jnp.stack([T.x - turned[:, 0], T.y - turned[:, 1], wrap(T.turn)], axis=-1)
