"""The image classifier in simulation: are a second drive's images of the classes of their places?

`python -m experiments.image_classifier --out DIR [--floors N]`

On each simulated floor, a camera takes 600 images of a mapping drive of five minutes; growing
neural gas of 150 neurons sorts them into classes. Then 300 images of another drive, in other light,
after a quarter of the doors and movable furniture were moved. Prints the share of these that falls
into a class registered at its place, or a neighbour of one, and the share of pairs of an image and
a place over 5 m away of which that holds: `here` and `far` with the classes of all mapping images
within 1 m and 40° of the place, `nearest` with the one class of the image there. Writes
`image_classifier.csv`, `image_classifier.png`, `configuration.json` and `images.png`, views of both
drives at the same places.
"""

import argparse
import dataclasses
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from aprjax.places.classifier import ViewClassifier
from aprjax.places.features import image_features
from aprjax.places.neural_gas import NeuralGasConfig
from aprjax.places.recognition import recognition
from aprjax.sim.camera import Camera, take_images
from aprjax.sim.drive import drive
from aprjax.sim.floor_plan import office
from aprjax.sim.textures import Textures
from experiments.outputs import print_table, write_configuration, write_figure, write_table
from experiments.scan_classifier import draw, with_mean

MAPPING, SECOND = (600, 0.5), (300, 1.0)  # images, and seconds between them
REARRANGED = 0.25  # share of the movable things that stand elsewhere in the second drive


@dataclasses.dataclass(frozen=True)
class Drive:
    """Images `(N, rows, columns, 3)` and true poses `(N, 3)`."""

    images: np.ndarray
    poses: np.ndarray


def main() -> int:
    """Drive, train, classify, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--floors", type=int, default=5, metavar="N")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    rows = []
    for floor in range(arguments.floors):
        mapping, second = drives(floor, Camera())
        classifier = ViewClassifier.train(list(mapping.images), image_features, floor)
        result = recognition(
            classifier.gas,
            (mapping.poses, classifier.classify(list(mapping.images))),
            (second.poses, classifier.classify(list(second.images))),
        )
        rows.append({"floor": floor, **dataclasses.asdict(result)})
    rows = with_mean(rows)
    print_table(rows)
    write_table(rows, arguments.out / "image_classifier.csv")
    write_figure(draw(rows), arguments.out / "image_classifier.png")
    write_figure(views(), arguments.out / "images.png", dpi=100)
    write_configuration(
        arguments.out, floors=list(range(arguments.floors)), mapping=MAPPING, second=SECOND,
        rearranged=REARRANGED, camera=dataclasses.asdict(Camera()),
        gas=dataclasses.asdict(NeuralGasConfig()),
    )  # fmt: skip
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


def views(pairs: int = 4) -> Figure:
    """Views of both drives at about the same places, finer than the classifier gets them."""
    mapping, second = drives(0, Camera(rows=48, columns=192))
    gap = second.poses[:, None] - mapping.poses
    turn = np.abs((gap[..., 2] + np.pi) % (2 * np.pi) - np.pi)
    cost = np.hypot(gap[..., 0], gap[..., 1]) + turn
    near = np.argsort(cost.min(axis=1))[:100]
    figure = Figure(figsize=(12, 1.7 * pairs), layout="constrained")
    axes = figure.subplots(pairs, 2)
    for ax, index in zip(axes, near[:: 100 // pairs], strict=False):
        ax[0].imshow(mapping.images[cost[index].argmin()])
        ax[1].imshow(second.images[index])
    for ax, title in zip(axes[0], ("mapping drive", "second drive"), strict=True):
        ax.set_title(title)
    for ax in axes.flat:
        ax.set_axis_off()
    return figure


if __name__ == "__main__":
    sys.exit(main())
