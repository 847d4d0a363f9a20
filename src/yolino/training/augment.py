"""Image file to augmented training image: one 3x3 matrix moves the pixels and the vertices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from yolino.geometry import fit_matrix, transform_points
from yolino.training.erase import erase_outer_line
from yolino.training.frames import Frames, corners_of, reduction, warp_pixels
from yolino.training.photometric import Photometric, check_probabilities
from yolino.training.repaint import repaint_lines
from yolino.training.seams import add_seams
from yolino.training.surfaces import add_surfaces
from yolino.types import Polylines, Sample

Matrix = Float[np.ndarray, "3 3"]

PRESETS: dict[str, dict[str, Any]] = {
    "none": {},
    "paper": {  # section "Data augmentation", front-view data sets
        "geometric": {"rotation_degrees": 36.0, "crop": 0.18},
        "photometric": {"brightness": 0.5, "contrast": 0.5, "saturation": 0.5, "hue": 0.2, "erasing": 0.5},
    },
    "gentle": {  # a camera that looks along the road stays upright
        "geometric": {
            "rotation_degrees": 4.0,
            "scale": (0.8, 1.25),
            "stretch": 1.15,
            "shear": 0.3,
            "horizon": 0.27,
            "perspective": 0.04,
            "shift": (0.1, 0.06),
            "flip": 0.5,
        },
        "photometric": {
            "brightness": 0.3,
            "contrast": 0.3,
            "saturation": 0.4,
            "hue": 0.03,
            "gain": 0.08,
            "temperature": 0.12,
            "gamma": 1.5,
            "shadow": 0.3,
            "glare": 0.2,
            "blur": 0.15,
            "noise": 0.25,
            "jpeg": 0.1,
            "erasing": 0.2,
            "erasing_area": (0.005, 0.05),
        },
        "lines": {"erase": 0.25},
    },
    "aerial": {  # no direction is up; a mirror image would drive on the other side of the road
        "geometric": {
            "rotation_degrees": 180.0,
            "scale": (0.8, 1.1),
            "stretch": 1.1,
            "crop": 0.18,
        },
        "photometric": {
            "brightness": 0.3,
            "contrast": 0.3,
            "saturation": 0.4,
            "hue": 0.03,
            "gain": 0.08,
            "temperature": 0.1,
            "gamma": 1.4,
            "shadow": 0.2,
            "blur": 0.1,
            "noise": 0.2,
            "jpeg": 0.1,
            "erasing": 0.2,
            "erasing_area": (0.005, 0.05),
        },
    },
}
PRESETS["road"] = {  # lane markings: what is beside the paint, and the paint itself, change too
    **PRESETS["gentle"],
    "lines": {"erase": 0.25, "repaint": 0.4, "seam": 0.3},
}


class Augmented(NamedTuple):
    """A training image with its labels, all in pixels of the network frame."""

    image: UInt8[np.ndarray, "h w 3"]
    polylines: Polylines
    ignore: tuple[Float[np.ndarray, "v 2"], ...]


@dataclass(frozen=True, kw_only=True)
class Geometric:
    """Random motions of the image plane, drawn anew for each image as one matrix of the network frame.

    Attributes:
        rotation_degrees: Largest turn about the center, to either side.
        scale: Least and largest zoom.
        stretch: Largest ratio of the horizontal to the vertical zoom; the smallest is its reciprocal.
        shear: Largest sideways motion per row below the horizon: the camera moved within the road.
        horizon: Row that the shear leaves in place, as a fraction of the height.
        perspective: Largest relative change of depth between the center and an edge.
        shift: Largest shift along x and y as fractions of the width and the height.
        crop: Largest part of the height and width that a crop window loses; the window fills the image again.
        flip: Probability of a mirror image, left and right exchanged.
        flip_vertical: Probability of a mirror image, top and bottom exchanged.
    """

    rotation_degrees: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)
    stretch: float = 1.0
    shear: float = 0.0
    horizon: float = 0.5
    perspective: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    crop: float = 0.0
    flip: float = 0.0
    flip_vertical: float = 0.0

    def __post_init__(self) -> None:
        low, high = self.scale
        if not 0 < low <= high:
            raise ValueError(f"scale is {self.scale}, but must be (least, largest), both above 0.")
        if self.stretch < 1:
            raise ValueError(f"stretch is {self.stretch}, but must be a ratio of at least 1.")
        if not 0 <= self.perspective <= 0.1:
            raise ValueError(f"perspective is {self.perspective}, but must lie in 0..0.1.")
        if not 0 <= self.crop < 1:
            raise ValueError(f"crop is {self.crop}, but must be at least 0 and less than 1.")
        check_probabilities(self, "flip", "flip_vertical")

    def sample(self, size: tuple[int, int], rng: np.random.Generator) -> Matrix:
        """Gives a random matrix from the network frame of `size` (height, width) to itself."""
        height, width = size
        draw = rng.uniform(-1, 1, 8)
        angle = np.deg2rad(self.rotation_degrees) * draw[0]
        zoom = np.exp(rng.uniform(*np.log(self.scale)))
        ratio = self.stretch ** (0.5 * draw[1])
        mirror = np.where(rng.random(2) < (self.flip, self.flip_vertical), -1.0, 1.0)
        shear = np.array([[1.0, self.shear * draw[2], 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        depth = np.eye(3)
        depth[2, :2] = self.perspective * draw[3:5] / (width / 2, height / 2)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        inner = turn @ np.diag([zoom * ratio * mirror[0], zoom / ratio * mirror[1], 1.0]) @ depth
        shift = (width, height) * np.asarray(self.shift) * draw[5:7]
        matrix = _about(inner, width / 2, height / 2) @ _about(shear, 0.0, self.horizon * height)
        return np.asarray(self._crop(size, rng) @ _translation(*shift) @ matrix)

    def _crop(self, size: tuple[int, int], rng: np.random.Generator) -> Matrix:
        rest = 1.0 - self.crop * rng.random()
        corner = rng.random(2) * (1.0 - rest) * (size[1], size[0])
        return np.asarray(np.diag([1 / rest, 1 / rest, 1.0]) @ _translation(*-corner))


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Random changes of single polylines together with their pixels.

    They are for lines that run up the image side by side, such as the boundaries of lanes.

    Attributes:
        erase: Probability that an outer polyline is removed, see `yolino.training.erase`.
        repaint: Probability, for each polyline, of a new marking, see `yolino.training.repaint`.
        seam: Probability, for each polyline, of a seam beside it, see `yolino.training.seams`.
        surface: Probability, for each polyline, that the ground beside it changes, see
            `yolino.training.surfaces`.
    """

    erase: float = 0.0
    repaint: float = 0.0
    seam: float = 0.0
    surface: float = 0.0

    def __post_init__(self) -> None:
        check_probabilities(self, "erase", "repaint", "seam", "surface")


GROUPS: dict[str, type[Any]] = {"geometric": Geometric, "photometric": Photometric, "lines": Lines}


class Augment:
    """Turns a sample into a training image of the network's size with its labels in the network frame.

    Polylines keep their direction and their vertices outside the image; the grid clips them.
    """

    def __init__(
        self,
        size: tuple[int, int],
        *,
        fit: str = "bottom",
        geometric: Mapping[str, Any] | None = None,
        photometric: Mapping[str, Any] | None = None,
        lines: Mapping[str, Any] | None = None,
        mosaic: float | int = 0.0,
        fill: int = 114,
        frames: Frames | None = None,
    ) -> None:
        """Takes the network's size and what may change; without changes the image is only fitted.

        Args:
            size: `(height, width)` of the network's input.
            fit: How the image frame meets the network frame, see `yolino.geometry.fit_matrix`.
            geometric: Arguments of `Geometric`.
            photometric: Arguments of `Photometric`.
            lines: Arguments of `Lines`.
            mosaic: Probability that an example is joined of two images, see `yolino.training.mosaic`; whoever
                draws the samples does it.
            fill: Gray value where the image does not reach.
            frames: Where pixels come from; by default files are decoded.
        """
        self.frames = frames or Frames()
        self.size = (int(size[0]), int(size[1]))
        self.fit = fit
        self.lines = Lines(**_arguments(lines))
        self.mosaic, self.fill = float(mosaic), fill
        check_probabilities(self, "mosaic")
        self.geometric = Geometric(**_arguments(geometric))
        self.photometric = Photometric(**_arguments(photometric))
        fit_matrix((1, 1), self.size, fit)  # says now, not in a worker, what is wrong

    def __call__(self, sample: Sample, rng: np.random.Generator, *, classes: Sequence[str] = ()) -> Augmented:
        """Gives the augmented image and labels; the same `rng` state gives the same result.

        Args:
            sample: The sample.
            rng: Source of randomness.
            classes: Names of the classes that its labels stand for: a new marking needs another label.
        """
        source = self.frames.open(sample.image)
        source_size = self.frames.size(source)
        matrix = self.geometric.sample(self.size, rng) @ fit_matrix(source_size, self.size, self.fit)
        reduce = reduction(matrix, self.size)
        pixels = self.frames.pixels(source, reduce, source_size)
        image = warp_pixels(pixels, reduce, matrix, self.size, fill=self.fill)
        polylines = sample.polylines.with_vertices(transform_points(sample.polylines.vertices, matrix))
        corners = transform_points(corners_of(source_size), matrix)
        image, polylines = self._change_lines(image, polylines, corners, classes, rng)
        ignore = tuple(transform_points(np.asarray(polygon, np.float64), matrix) for polygon in sample.ignore)
        return Augmented(self.photometric(image, rng), polylines, ignore)

    def _change_lines(
        self,
        image: UInt8[np.ndarray, "h w 3"],
        polylines: Polylines,
        corners: Float[np.ndarray, "4 2"],
        classes: Sequence[str],
        rng: np.random.Generator,
    ) -> tuple[UInt8[np.ndarray, "h w 3"], Polylines]:
        """Gives image and labels after the changes of single lines; `corners` are those of the picture."""
        lines = self.lines
        if rng.random() < lines.erase:
            image, polylines = erase_outer_line(image, polylines, rng, corners=corners)
        # What is switched off draws nothing, so that it changes no example of older experiments.
        if lines.surface:
            image = add_surfaces(image, polylines, rng, share=lines.surface, corners=corners)
        if lines.repaint:
            image, polylines = repaint_lines(
                image, polylines, rng, share=lines.repaint, classes=classes, corners=corners
            )
        if lines.seam:
            image = add_seams(image, polylines, rng, share=lines.seam, corners=corners)
        return image, polylines


def _arguments(values: Mapping[str, Any] | None) -> dict[str, Any]:
    """Gives values of an experiment file with lists as tuples of floats, and integers as floats."""
    return {
        name: tuple(float(v) for v in value) if isinstance(value, Sequence) else float(value)
        for name, value in (values or {}).items()
    }


def _translation(x: float, y: float) -> Matrix:
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def _about(matrix: Matrix, x: float, y: float) -> Matrix:
    """Gives `matrix` with the point `(x, y)` as its origin."""
    return np.asarray(_translation(x, y) @ matrix @ _translation(-x, -y))
