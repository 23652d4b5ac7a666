"""Local refinement of an alignment: point-to-line least squares between two scans.

Not in the paper, which evaluates the centre of gravity as it is; anchors place a scan to about a
decimetre and two degrees, and the congruence of raw data needs better. `settle` takes a few cheap
steps with ever smaller gates; `estimate` then solves once, with a model of the scanner's errors.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.view import View, facing
from aprjax.numerics import HIGHEST, arctan2, dot, safe_norm, sums, take, wrap
from aprjax.se2 import Pose, inverse, transform

_LEAST = 1e-6  # metres and radians: what divides is never zero, and its square is a float32


class SettleConfig(eqx.Module):
    """How points and surfaces are paired, and how often."""

    gate: Float[Array, ""] = threshold(
        0.5, "metres off the surface that are allowed at first", least=_LEAST
    )
    final_gate: Float[Array, ""] = threshold(0.1, "metres at last", least=_LEAST)
    reach: Float[Array, ""] = threshold(3.0, "gates that paired points may lie apart in all")
    points: int = capacity(128, "most end points that are paired in a coarse step")
    iterations: int = capacity(6, "coarse steps", least=0)


class RefineConfig(SettleConfig):
    """The same, and the errors of the distances, for the last solve."""

    noise: Float[Array, ""] = threshold(
        0.0058, "metres: standard deviation of a range, with its rounding to a centimetre"
    )
    noise_per_metre: Float[Array, ""] = threshold(0.0005, "what range adds to it, metres a metre")
    bias: Float[Array, ""] = threshold(
        0.0087,
        "metres: standard deviation of the error that all ranges of a scan share",
        least=_LEAST,
    )
    roughness: Float[Array, ""] = threshold(
        0.003,
        "metres: standard deviation of a surface off the line that stands for it",
        least=_LEAST,
    )
    outlier: Float[Array, ""] = threshold(
        4.0, "standard deviations at which a pair has no say", least=0.001
    )
    cluster: Float[Array, ""] = threshold(
        20.0, "neighbouring pairs that share what their distances have beyond these errors"
    )
    trust: Float[Array, ""] = threshold(
        0.05,
        "metres and radians: standard deviation of the pose that the last solve starts from",
        least=_LEAST,
    )
    prior: Float[Array, ""] = threshold(
        1.0,
        "metres and radians: standard deviation of each coordinate where nothing holds it",
        least=_LEAST,
    )
    beams: int = capacity(128, "most end points of each scan that are paired in the last solve")
    solver_steps: int = capacity(4, "most evaluations of the last solve")


class Refined(eqx.Module):
    """A refined alignment."""

    T_ref_query: Pose
    """Metres and radians."""
    covariance: Float[Array, "*batch 3 3"]
    """m², m rad, rad²: long in a direction in which no surface holds the query."""


class _Pairs(eqx.Module):
    """End points of a front scan, and the lines seen by an overview scan that they should lie on.

    Linear in five unknowns: the front's pose in the overview's frame, and the errors that all
    ranges of the front, and of the overview, share.
    """

    off: Float[Array, " pairs"]
    """Signed distances off the lines in standard deviations, zero where a pair is not real."""
    jacobian: Float[Array, "pairs 5"]
    real: Bool[Array, " pairs"]


def settle(reference: View, query: View, T_ref_query: Pose, config: SettleConfig) -> Pose:
    """The pose near `T_ref_query` at which the query's end points lie on the reference's surfaces.

    A fixed number of cheap steps with a robust weight (Tukey's) whose scale shrinks from one gate
    to the other. Where no points can be paired the pose stays as it is.
    """
    beam, real = query.thin(config.points)
    real = real & query.hit[beam]
    query_x, query_y = query.xy[beam, 0], query.xy[beam, 1]
    # Coordinate by coordinate: XLA on a CPU does not vectorise so short an axis.
    line_x, line_y = reference.xy[:, 0], reference.xy[:, 1]
    line_normal_x, line_normal_y = reference.normal[:, 0], reference.normal[:, 1]

    def look(x: Array, y: Array, angle: Array) -> tuple[Array, Array, Array]:
        """Query points turned, and the surfaces they are looked up at; -1 - k if not in view.

        One array of numbers: truth values are not vectorised by XLA on a CPU.
        """
        cos, sin = jnp.cos(angle), jnp.sin(angle)
        arm_x, arm_y = cos * query_x - sin * query_y, sin * query_x + cos * query_y
        index, visible = reference.scanner.towards(arctan2(arm_y + y, arm_x + x))
        return arm_x, arm_y, jnp.where(visible & real, index, -1 - index)

    # The look ahead belongs to the step before: what passes from one round of a loop to the next
    # is computed once, where XLA on a CPU fuses indices into each of the gathers that use them.
    def step(carry: tuple[Any, Any], gate: Float[Array, ""]) -> tuple[tuple[Any, Any], None]:
        (x, y, angle), (arm_x, arm_y, seen) = carry
        index = jnp.maximum(seen, -1 - seen)
        normal_x, normal_y = take(line_normal_x, index), take(line_normal_y, index)
        gap_x, gap_y = arm_x + x - take(line_x, index), arm_y + y - take(line_y, index)
        near = gap_x**2 + gap_y**2 < (config.reach * gate) ** 2
        paired = (seen >= 0) & near & (normal_x**2 + normal_y**2 > 0)
        off = normal_x * gap_x + normal_y * gap_y
        weight = jnp.where(paired, jnp.maximum(1.0 - (off / gate) ** 2, 0.0) ** 2, 0.0)
        columns = (normal_x, normal_y, normal_y * arm_x - normal_x * arm_y)
        products = [a * b for k, a in enumerate(columns) for b in (*columns[k:], off)]
        dx, dy, turn = _damped_step(*sums(*(weight * product for product in products)))
        pose = (x - dx, y - dy, wrap(angle - turn))
        return (pose, look(*pose)), None

    shrink = config.final_gate / config.gate
    gates = config.gate * shrink ** jnp.linspace(0.0, 1.0, config.iterations)
    start = (T_ref_query[0], T_ref_query[1], T_ref_query[2])
    (pose, _), _ = jax.lax.scan(step, (start, look(*start)), gates)
    return jnp.stack(pose)


def refine(reference: View, query: View, T_ref_query: Pose, config: RefineConfig) -> Refined:
    """`settle`, then `estimate`."""
    return estimate(reference, query, settle(reference, query, T_ref_query, config), config)


def estimate(reference: View, query: View, T_ref_query: Pose, config: RefineConfig) -> Refined:
    """The pose near `T_ref_query` at which each scan's end points lie on the other's surfaces.

    Points and surfaces are paired once, both ways, and their distances minimised with Tukey's
    loss over five unknowns: the pose, and for each scan the error that all of its ranges share.
    That error moves a whole wall, so no number of beams averages it out; as an unknown with the
    scanner's systematic deviation for a prior it is estimated where walls face each other, and
    elsewhere it widens the covariance in the direction that was seen.

    The solve trusts its start to `trust`: where few surfaces hold the pose, a robust loss has
    minima far away. The covariance makes no use of that. It is that of the pose in the inverse
    curvature at the minimum. A distance has the variance of the range noise of both its ends,
    as far as that is along the normal, and of the surface's roughness. Where several points are
    paired with one point of the other scan they share its noise, which then counts so many
    times. Both ways see the same noise, so each way counts for half. What the residuals have
    beyond this, in the mean square, is no noise but something in the wrong place, which
    neighbouring beams share; with m the mean square over its expectation and n such beams, the
    variance grows by Kish's design effect (Survey Sampling, 1965): m (1 + (n - 1) (m - 1) / m)
    = 1 + n (m - 1). A weak prior on the pose keeps everything finite, also where there are no
    pairs.
    """
    pairs = _both_ways(reference, query, T_ref_query, config)
    prior = 1.0 / jnp.stack([config.prior] * 3 + [config.bias] * 2)
    trust = 1.0 / jnp.stack([config.trust] * 3 + [config.bias] * 2)

    def residuals(step: Float[Array, "5"], _: None) -> tuple[Array, Array]:
        off = pairs.off + jnp.matmul(pairs.jacobian, step, precision=HIGHEST)
        return _tukey(off, config.outlier), trust * step

    solution = optx.least_squares(
        residuals,
        optx.GaussNewton(rtol=1e-4, atol=1e-5, linear_solver=_NormalEquations()),
        jnp.zeros(5),
        max_steps=config.solver_steps,
        throw=False,
    )
    step = solution.value
    of_pairs, _ = residuals(step, None)
    slope, _ = jax.jacfwd(residuals)(step, None)
    mean_square = jnp.sum(of_pairs**2) / jnp.maximum(
        0.5 * jnp.sum(pairs.real, dtype=jnp.float32), 1.0
    )
    inflation = 1.0 + config.cluster * jnp.maximum(mean_square - 1.0, 0.0)
    information = _gram(slope) / inflation + jnp.diag(prior**2)
    T_ref_query = (T_ref_query + step[:3]).at[2].set(wrap(T_ref_query[2] + step[2]))
    return Refined(T_ref_query, _inverse(information)[:3, :3])


def _both_ways(reference: View, query: View, T_ref_query: Pose, config: RefineConfig) -> _Pairs:
    """The query's end points on the reference's surfaces, and the other way about."""
    overviews, fronts = facing(reference, query)
    T_overview_front = jnp.stack([T_ref_query, inverse(T_ref_query)])
    pairs = jax.vmap(_pairs, (0, 0, 0, None))(overviews, fronts, T_overview_front, config)
    # Back, the unknowns are the inverse pose, and the shared errors the other way round.
    change = jnp.zeros((5, 5)).at[:3, :3].set(jax.jacfwd(inverse)(T_ref_query))
    change = change.at[3, 4].set(1.0).at[4, 3].set(1.0)
    back = jnp.matmul(pairs.jacobian[1], change, precision=HIGHEST)
    return _Pairs(
        off=pairs.off.reshape(-1),
        jacobian=jnp.concatenate([pairs.jacobian[0], back]),
        real=pairs.real.reshape(-1),
    )


def _pairs(overview: View, front: View, T_overview_front: Pose, config: RefineConfig) -> _Pairs:
    """The front's end points and the overview's surfaces where they would be seen."""
    beam, real = front.thin(config.beams)
    xy = transform(T_overview_front, front.xy[beam])
    index, near = _paired(overview, xy, config.reach * config.final_gate)
    real = near & real & front.hit[beam]
    normal, line_xy = overview.normal[index], overview.xy[index]
    arm = xy - T_overview_front[None, :2]

    def seen(ray: Float[Array, "pairs 2"], step: Float[Array, ""]):
        """Cosine of the incidence, variance along the normal, spacing of hits on the surface."""
        distance = jnp.maximum(safe_norm(ray), 1e-3)
        cosine = dot(normal, ray) / distance
        variance = config.noise**2 + (config.noise_per_metre * distance) ** 2
        spacing = distance * step / jnp.maximum(jnp.abs(cosine), 0.1)
        return cosine, cosine**2 * variance, spacing

    thinned = jnp.maximum(front.beams.astype(jnp.float32) / beam.shape[0], 1.0)
    of_front, variance, spacing = seen(arm, thinned * jnp.abs(front.angle_increment))
    of_overview, shared, line_spacing = seen(line_xy, jnp.abs(overview.angle_increment))
    sharing = jnp.maximum(line_spacing / jnp.maximum(spacing, 1e-6), 1.0)
    weight = jnp.where(real, jax.lax.rsqrt(variance + sharing * shared + config.roughness**2), 0.0)
    turning = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
    columns = [normal[:, 0], normal[:, 1], turning, -of_front, of_overview]
    return _Pairs(
        off=weight * dot(normal, xy - line_xy),
        jacobian=weight[:, None] * jnp.stack(columns, axis=-1),
        real=real,
    )


def _paired(
    reference: View, xy: Float[Array, "points 2"], reach: Float[Array, ""]
) -> tuple[Int[Array, " points"], Bool[Array, " points"]]:
    """The entry seen in each point's direction, and whether its surface is within reach."""
    index, visible = reference.look_up(xy)
    gap = xy - reference.xy[index]
    near = dot(gap, gap) < reach**2
    normal = reference.normal[index]
    return index, visible & near & (dot(normal, normal) > 0)


def _tukey(distances: Float[Array, " pairs"], outlier: Float[Array, ""]) -> Float[Array, " pairs"]:
    """Residuals whose squares are Tukey's loss, at half weight: each pair is there both ways."""
    share = jnp.minimum((distances / outlier) ** 2, 1.0)
    inside = distances * jnp.sqrt(0.5 * (1.0 - share + share**2 / 3.0))
    return jnp.where(share < 1.0, inside, outlier / jnp.sqrt(6.0))


class _NormalEquations(lx.AbstractLinearSolver):
    """Linear least squares in few unknowns by `_inverse`, which is finite along a corridor too."""

    def init(self, operator: lx.AbstractLinearOperator, options: dict[str, Any]):
        jacobian = operator.as_matrix()
        return _inverse(_gram(jacobian)), jacobian

    def compute(self, state: Any, vector: Any, options: dict[str, Any]):
        inverse_square, jacobian = state
        gradient = jnp.matmul(jnp.concatenate(jax.tree.leaves(vector)), jacobian, precision=HIGHEST)
        step = jnp.matmul(inverse_square, gradient, precision=HIGHEST)
        return step, lx.RESULTS.successful, {}

    def transpose(self, state: Any, options: dict[str, Any]):
        raise NotImplementedError("least squares never solves the transposed system")

    def conj(self, state: Any, options: dict[str, Any]):
        return state, options

    def assume_full_rank(self) -> bool:
        return True


def _damped_step(
    xx: Array, xy: Array, xt: Array, x: Array, yy: Array, yt: Array, y: Array, tt: Array, t: Array
) -> tuple[Array, Array, Array]:
    """The solution of three normal equations, number by number.

    The upper triangle row by row, each with the right-hand side at its end. By the factors L D Lᵀ;
    one unit of damping is one point: nothing against a wall, enough along a corridor.
    """
    xx, yy, tt = xx + 1.0, yy + 1.0, tt + 1.0
    l_y, l_t = xy / xx, xt / xx
    d_y = jnp.maximum(yy - l_y * xy, 1e-6 * yy)
    rest = yt - l_t * xy
    l_ty = rest / d_y
    d_t = jnp.maximum(tt - l_t * xt - l_ty * rest, 1e-6 * tt)
    y = y - l_y * x
    t = (t - l_t * x - l_ty * y) / d_t
    y = y / d_y - l_ty * t
    return x / xx - l_y * y - l_t * t, y, t


def _gram(columns: Float[Array, "pairs n"]) -> Float[Array, "n n"]:
    """Products of all columns with each other. With long rows a CPU is several times as fast."""
    rows = columns.T
    return jnp.einsum("ip,jp->ij", rows, rows, precision=HIGHEST)


def _inverse(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Inverse of a small symmetric positive definite matrix by its factors L D Lᵀ.

    Pivots are kept positive, so the result always is positive definite; LAPACK, which is called
    matrix by matrix, gives NaN where rounding in float32 takes one below zero.
    """
    size = matrix.shape[0]
    least = jnp.maximum(1e-6 * jnp.diagonal(matrix), jnp.finfo(jnp.float32).tiny)

    def eliminate(k: Array, left: Array) -> Array:
        pivot = jnp.maximum(left[k, k], least[k])
        factor = jnp.where(jnp.arange(size) > k, left[:, k] / pivot, 0.0)
        return left - factor[:, None] * left[k][None]

    start = jnp.concatenate([matrix, jnp.eye(size)], axis=1)
    # Unrolled, this would be a tenth of what XLA has to compile for a match.
    rows = jax.lax.fori_loop(0, size, eliminate, start)
    pivots = jnp.maximum(jnp.diagonal(rows), least)
    half = rows[:, size:] / jnp.sqrt(pivots)[:, None]
    return jnp.matmul(half.T, half, precision=HIGHEST)
