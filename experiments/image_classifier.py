"""The image classifier in simulation: are a second drive's images of the classes of their places?

`python experiments/image_classifier.py [--floors N] [--out DIR]`

On each simulated floor, a camera takes 600 images of a mapping drive of five minutes; growing
neural gas of 150 neurons sorts them into classes. Then 300 images of another drive, in other light,
after a quarter of the doors and movable furniture were moved. Prints the share of these that falls
into a class registered at its place, or a neighbour of one, and the share of pairs of an image and
a place over 5 m away of which that holds: `here` and `far` with the classes of all mapping images
within 1 m and 40° of the place, `nearest` with the one class of the image there. With `--out`, also
draws views of both drives at the same places to `images.png`.
"""

import argparse
import dataclasses
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from aprjax.places.classifier import ViewClassifier
from aprjax.places.features import image_features
from aprjax.places.recognition import recognition
from aprjax.sim.camera import Camera, take_images
from aprjax.sim.drive import drive
from aprjax.sim.floor_plan import office
from aprjax.sim.textures import Textures

MAPPING, SECOND = (600, 0.5), (300, 1.0)  # images, and seconds between them
REARRANGED = 0.25  # share of the movable things that stand elsewhere in the second drive


@dataclasses.dataclass(frozen=True)
class Drive:
    """Images `(N, rows, columns, 3)` and true poses `(N, 3)`."""

    images: np.ndarray
    poses: np.ndarray


def main() -> int:
    """Drive, train, classify, print; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--floors", type=int, default=5, metavar="N")
    parser.add_argument("--out", type=Path, metavar="DIR")
    arguments = parser.parse_args()

    print("floor  mapped   here    far  here_nearest  far_nearest")
    rows = []
    for floor in range(arguments.floors):
        mapping, second = drives(floor, Camera())
        classifier = ViewClassifier.train(list(mapping.images), image_features, floor)
        result = recognition(
            classifier.gas,
            (mapping.poses, classifier.classify(list(mapping.images))),
            (second.poses, classifier.classify(list(second.images))),
        )
        rows.append(dataclasses.astuple(result))
        show(str(floor), rows[-1])
    show("mean", tuple(np.mean(rows, axis=0)))
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        draw(arguments.out / "images.png")
    return 0


def drives(floor: int, camera: Camera) -> tuple[Drive, Drive]:
    """A mapping drive and a second one on the same floor."""
    first_way, second_way, moved, paint, first_light, second_light = (
        int(child.generate_state(1)[0]) for child in np.random.SeedSequence(floor).spawn(6)
    )
    plan = office(floor)
    later = plan.rearranged(moved, REARRANGED)
    textures = Textures.draw(paint, plan)
    poses = drive(first_way, plan, *MAPPING)[0], drive(second_way, later, *SECOND)[0]
    return (
        Drive(take_images(first_light, camera, plan, textures, poses[0]), poses[0]),
        Drive(take_images(second_light, camera, later, textures, poses[1]), poses[1]),
    )


def show(label: str, row: tuple) -> None:
    """One line of the table."""
    mapped, here, far, here_nearest, far_nearest = row
    shares = f"{here:.3f}  {far:.3f}  {here_nearest:12.3f}  {far_nearest:11.3f}"
    print(f"{label:5s}  {mapped:6.0f}  {shares}")


def draw(path: Path, pairs: int = 4) -> None:
    """Views of both drives at about the same places, finer than the classifier gets them."""
    mapping, second = drives(0, Camera(rows=48, columns=192))
    gap = second.poses[:, None] - mapping.poses
    turn = np.abs((gap[..., 2] + np.pi) % (2 * np.pi) - np.pi)
    cost = np.hypot(gap[..., 0], gap[..., 1]) + turn
    near = np.argsort(cost.min(axis=1))[:100]
    figure, axes = plt.subplots(pairs, 2, figsize=(12, 1.7 * pairs), layout="constrained")
    for ax, index in zip(axes, near[:: 100 // pairs], strict=False):
        ax[0].imshow(mapping.images[cost[index].argmin()])
        ax[1].imshow(second.images[index])
    for ax, title in zip(axes[0], ("mapping drive", "second drive"), strict=True):
        ax.set_title(title)
    for ax in axes.flat:
        ax.set_axis_off()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    sys.exit(main())
