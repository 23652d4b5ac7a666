"""From the alternatives of all references to the few that are worth synthetic scans.

Two cheap looks at ever fewer alternatives. The first sees them as they were aligned; a brief
refinement of those that pass lets the second look closer.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from aprjax.alignment.align import Alternatives
from aprjax.configuration import capacity
from aprjax.evaluation.screen import ScreenConfig, screen, sketch
from aprjax.evaluation.view import View
from aprjax.refine import RefineConfig, settle


class ShortlistConfig(eqx.Module):
    """The looks, and how many alternatives pass each."""

    screen: ScreenConfig = ScreenConfig()
    settle: RefineConfig = RefineConfig(points=48, iterations=3)
    closer: ScreenConfig = ScreenConfig(
        tolerance=0.08,  # pyright: ignore[reportArgumentType]
        relative=0.015,  # pyright: ignore[reportArgumentType]
        points=64,
    )
    passed: int = capacity(128, "alternatives that pass the first look, over all references")
    kept: int = capacity(24, "alternatives that pass the second")

    def __check_init__(self) -> None:
        for name in ("passed", "kept"):
            value = getattr(self, name)
            if value < 1:
                raise ValueError(f"{name}: {value} is not a positive number")


class Shortlist(eqx.Module):
    """Alternatives of several references, ordered by reference."""

    alternatives: Alternatives
    """`(size,)`."""
    row: Int[Array, " size"]
    """Which reference each belongs to."""

    def best(self, score: Float[Array, " size"], count: int) -> "Shortlist":
        """The `count` of the highest score, still ordered by reference: ties go to the lowest."""
        score = jnp.where(self.alternatives.valid, score, -1.0)
        _, index = jax.lax.top_k(score, min(count, score.shape[0]))
        index = jnp.sort(index)
        return jax.tree.map(lambda array: array[index], self)


def all_alternatives(aligned: Alternatives, rows: Int[Array, " references"]) -> Shortlist:
    """The alternatives `(references, maxima)` of one query in one row, none left out."""
    return Shortlist(
        alternatives=jax.tree.map(lambda array: array.reshape(-1, *array.shape[2:]), aligned),
        row=jnp.repeat(rows, aligned.valid.shape[1]),
    )


def shortlist(
    aligned: Alternatives,
    rows: Int[Array, " references"],
    references: View,
    query: View,
    config: ShortlistConfig,
) -> Shortlist:
    """The most promising of the alternatives `(references, maxima)` of one query.

    `rows` says which of the views in `references` each leading index of `aligned` stands for.
    """
    everything = all_alternatives(aligned, rows)
    if config.kept >= everything.row.shape[0]:
        return everything

    def look(
        found: Alternatives, row: Int[Array, " size"], screen_config: ScreenConfig
    ) -> Float[Array, " size"]:
        theirs = jax.vmap(sketch, (0, None))(references, screen_config)
        ours = sketch(query, screen_config)
        return jax.vmap(screen, (None, 0, None, 0, 0, None))(
            theirs, row, ours, found.T_ref_query, found.anchors, screen_config
        )

    first = look(everything.alternatives, everything.row, config.screen)
    if config.kept >= config.passed:
        return everything.best(first, config.kept)
    passed = everything.best(first, config.passed)

    def settled_one(found: Alternatives, row: Int[Array, ""]) -> Alternatives:
        reference = jax.tree.map(lambda array: array[row], references)
        T_ref_query = settle(reference, query, found.T_ref_query, config.settle)
        return eqx.tree_at(lambda a: a.T_ref_query, found, T_ref_query)

    settled = Shortlist(jax.vmap(settled_one)(passed.alternatives, passed.row), passed.row)
    return settled.best(look(settled.alternatives, settled.row, config.closer), config.kept)
