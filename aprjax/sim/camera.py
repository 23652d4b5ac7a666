"""A colour camera on the robot: small images of a floor's walls, doors and furniture.

Each column of pixels looks along one bearing; what it shows from floor to ceiling is what that
bearing meets: the first wall or door, and before it the first piece of furniture, as high as it
is. Legs, castors and people are left out: at the camera's height they are thin or not there.
"""

from dataclasses import dataclass

import numpy as np

from aprjax.sim.floor_plan import FloorPlan
from aprjax.sim.textures import CEILING, FLOOR, ROOM_HEIGHT, Textures


@dataclass(frozen=True)
class Camera:
    """A panoramic camera by default; a smaller `field_of_view` makes it a directed one.

    Raises `ValueError` naming the field where that makes no sense.
    """

    rows: int = 16
    columns: int = 64
    field_of_view: float = 2 * np.pi
    """Radians across all columns, the middle one looking ahead, the first to the left."""
    steepest: float = np.radians(40.0)
    """Radians that the outermost rows look up and down."""
    height: float = 1.0
    """Metres above the floor."""
    noise: float = 0.03
    """Standard deviation of a pixel, of a range from 0 to 1."""
    dimmest: float = 0.5
    """Brightness in the dimmest light; 1 in the brightest."""
    tint: float = 0.15
    """Share by which the light's colour shifts each channel up or down at most."""

    def __post_init__(self) -> None:
        for name, holds, condition in (
            ("rows", self.rows >= 1, "positive"),
            ("columns", self.columns >= 1, "positive"),
            ("field_of_view", 0 < self.field_of_view <= 2 * np.pi, "in (0, 2π]"),
            ("steepest", 0 < self.steepest < np.pi / 2, "in (0, π/2)"),
            ("height", 0 < self.height < ROOM_HEIGHT, f"in (0, {ROOM_HEIGHT})"),
            ("noise", 0 <= self.noise < np.inf, "in [0, ∞)"),
            ("dimmest", 0 < self.dimmest <= 1, "in (0, 1]"),
            ("tint", 0 <= self.tint < 1, "in [0, 1)"),
        ):
            if not holds:
                raise ValueError(f"{name}: {getattr(self, name)} is not {condition}")

    @property
    def bearings(self) -> np.ndarray:
        """Radians `(columns,)`, counter-clockwise from ahead; the first column is leftmost."""
        step = self.field_of_view / self.columns
        return self.field_of_view / 2 - step * (np.arange(self.columns) + 0.5)

    @property
    def slopes(self) -> np.ndarray:
        """Tangents `(rows,)` of the rows' elevations, the uppermost first."""
        return np.tan(self.steepest) * (1 - 2 * (np.arange(self.rows) + 0.5) / self.rows)


def take_images(
    seed: int, camera: Camera, plan: FloorPlan, textures: Textures, T_world_camera: np.ndarray
) -> np.ndarray:
    """Images `(N, rows, columns, 3)`, red, green, blue as bytes, from poses `(N, 3)` of one drive.

    `seed` draws the light and the noise: brightness and colour of the light start anywhere and
    drift along the drive. The same seed gives the same bits. Raises `ValueError` if the poses are
    not `(N, 3)` and finite.
    """
    poses = np.asarray(T_world_camera, float)
    if poses.ndim != 2 or poses.shape[1] != 3 or not np.all(np.isfinite(poses)):
        raise ValueError(f"T_world_camera: shape {poses.shape} is not (N, 3), or not all finite")
    rng = np.random.default_rng(seed)
    gains = _light(rng, camera, len(poses))
    scene = _Scene.of(plan)
    images = np.zeros((len(poses), camera.rows, camera.columns, 3), np.uint8)
    for image, pose, gain in zip(images, poses, gains, strict=True):
        seen = _render(camera, scene, textures, pose) * gain
        seen = seen + camera.noise * rng.normal(size=seen.shape)
        image[:] = np.round(255 * np.clip(seen, 0.0, 1.0))
    return images


@dataclass(frozen=True)
class _Scene:
    """The surfaces of a floor at one time, and which texture each has."""

    tall: np.ndarray
    """`(T, 2, 2)`: walls, then door leaves, from floor to ceiling."""
    low: np.ndarray
    """`(L, 2, 2)`: sides of furniture."""
    piece: np.ndarray
    """`(L,)`: the piece of furniture that each side belongs to."""

    @classmethod
    def of(cls, plan: FloorPlan) -> "_Scene":
        sides = [piece.surfaces[0] for piece in plan.furniture]
        return cls(
            tall=np.concatenate([plan.walls, *(door.leaf[None] for door in plan.doors)]),
            low=np.concatenate([np.zeros((0, 2, 2)), *sides]),
            piece=np.repeat(np.arange(len(sides)), [len(side) for side in sides]),
        )


def _render(
    camera: Camera, scene: _Scene, textures: Textures, T_world_camera: np.ndarray
) -> np.ndarray:
    """What there is to see `(rows, columns, 3)` in even light, from 0 to 1."""
    angles = T_world_camera[2] + camera.bearings
    distance, wall, along = _first_hit(scene.tall, T_world_camera[:2], angles)
    height = camera.height + camera.slopes[:, None] * distance
    image = textures.wall(wall, along, height)
    image[height > ROOM_HEIGHT] = CEILING
    image[height < 0] = FLOOR
    if len(scene.low):
        nearer, side, _ = _first_hit(scene.low, T_world_camera[:2], angles)
        piece = scene.piece[side]
        top = np.where(nearer < distance, textures.furniture_height[piece], -1.0)
        reach = camera.height + camera.slopes[:, None] * np.where(np.isfinite(nearer), nearer, 0.0)
        covered = (reach < top) & (reach >= 0)
        image = np.where(covered[..., None], textures.furniture[piece], image)
    return image


def _first_hit(
    segments: np.ndarray, position: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Along each of the rays: metres to the first segment, its number, and metres along it.

    Infinite, and segment 0, where there is none.
    """
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None]
    side = segments[:, 1] - segments[:, 0]
    offset = segments[:, 0] - position
    cross = ray[..., 0] * side[:, 1] - ray[..., 1] * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (offset[:, 0] * side[:, 1] - offset[:, 1] * side[:, 0]) / cross
        share = (offset[:, 0] * ray[..., 1] - offset[:, 1] * ray[..., 0]) / cross
    # No ray slips between two segments that share an end.
    hit = (cross != 0) & (distance > 0) & (share >= -1e-9) & (share <= 1 + 1e-9)
    distance = np.where(hit, distance, np.inf)
    first = distance.argmin(axis=1)
    row = np.arange(len(angles))
    length = np.hypot(*side[first].T)
    return distance[row, first], first, np.where(hit[row, first], share[row, first], 0.0) * length


def _light(rng: np.random.Generator, camera: Camera, count: int) -> np.ndarray:
    """Gains `(count, 3)` of the channels: a level and a tint, each drifting about its own mean."""
    time = np.linspace(0.0, 1.0, max(count, 2))[:count, None]

    def drift(width: int) -> np.ndarray:
        phase, cycles = rng.uniform(0, 2 * np.pi, width), rng.uniform(0.5, 4.0, width)
        mean = rng.uniform(-0.5, 0.5, width)
        return mean + 0.5 * np.sin(phase + 2 * np.pi * cycles * time)  # in [-1, 1]

    level = camera.dimmest + (1 - camera.dimmest) * (0.5 + 0.5 * drift(1))
    return level * (1 + camera.tint * drift(3))
