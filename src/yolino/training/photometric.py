"""Augmentation of the pixels alone: color, light, blur, noise, compression. Fast on uint8 at network size."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

Image = UInt8[np.ndarray, "h w 3"]

_LUMA = np.array([0.299, 0.587, 0.114])
_YIQ = np.array([[0.299, 0.587, 0.114], [0.596, -0.274, -0.322], [0.211, -0.523, 0.312]])


@dataclass(frozen=True, kw_only=True)
class Photometric:
    """Random changes of the pixels, drawn anew for each image.

    Attributes:
        brightness: Largest relative change of all values (0.5: a factor of 0.5 to 1.5).
        contrast: Largest relative change of the distance to the image's mean gray.
        saturation: Largest relative change of the distance to each pixel's own gray.
        hue: Largest turn of the hue, as a fraction of the color circle.
        gain: Largest relative change of each channel on its own.
        temperature: Largest relative change of red against blue.
        gamma: Largest exponent; the smallest is its reciprocal.
        shadow: Probability of dark polygons with soft edges.
        glare: Probability of a glow and a gradient of light.
        blur: Probability of a Gaussian or motion blur.
        noise: Probability of pixel noise.
        jpeg: Probability of compression artefacts.
        erasing: Probability that a rectangle is replaced by noise.
        erasing_area: Least and largest area of that rectangle as a fraction of the image.
    """

    brightness: float = 0.0
    contrast: float = 0.0
    saturation: float = 0.0
    hue: float = 0.0
    gain: float = 0.0
    temperature: float = 0.0
    gamma: float = 1.0
    shadow: float = 0.0
    glare: float = 0.0
    blur: float = 0.0
    noise: float = 0.0
    jpeg: float = 0.0
    erasing: float = 0.0
    erasing_area: tuple[float, float] = (0.02, 0.15)

    def __post_init__(self) -> None:
        check_probabilities(self, "shadow", "glare", "blur", "noise", "jpeg", "erasing")
        if self.gamma < 1:
            raise ValueError(f"gamma is {self.gamma}, but must be an exponent of at least 1.")
        low, high = self.erasing_area
        if not 0 < low <= high <= 1:
            raise ValueError(f"erasing_area is {self.erasing_area}, but must be (least, largest) in 0..1.")

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """Gives a changed copy of `image`."""
        if rng.random() < self.shadow:
            image = cast_shadows(image, rng)
        image = self._jitter(image, rng)
        if rng.random() < self.glare:
            image = add_glare(image, rng)
        if rng.random() < self.blur:
            image = blur(image, rng)
        if rng.random() < self.noise:
            image = add_noise(image, rng)
        if rng.random() < self.jpeg:
            image = compress(image, rng)
        if rng.random() < self.erasing:
            image = erase_rectangle(image, rng, self.erasing_area)
        return image

    def _jitter(self, image: Image, rng: np.random.Generator) -> Image:
        """All linear color changes are one 3x4 matrix, gamma is one table."""
        matrix = self.color_matrix(np.asarray(cv2.mean(image)[:3]), rng)
        if not np.array_equal(matrix, np.eye(3, 4)):
            image = np.asarray(cv2.transform(image, matrix.astype(np.float32)))
        if self.gamma != 1.0:
            exponent = self.gamma ** rng.uniform(-1, 1)
            table = 255.0 * (np.arange(256) / 255.0) ** exponent
            image = np.asarray(cv2.LUT(image, np.rint(table).astype(np.uint8)))
        return image

    def color_matrix(
        self, mean: Float[np.ndarray, " 3"], rng: np.random.Generator
    ) -> Float[np.ndarray, "3 4"]:
        """Gives a random affine map of RGB values; `mean` is the mean color of the image."""
        brightness, contrast, saturation, hue, warm = rng.uniform(-1, 1, 5)
        gains = 1 + self.gain * rng.uniform(-1, 1, 3)
        gains *= 1 + self.temperature * warm * np.array([1.0, 0.0, -1.0])
        matrix = np.diag(gains) * (1 + self.brightness * brightness)
        s = 1 + self.saturation * saturation
        matrix = (s * np.eye(3) + (1 - s) * np.outer(np.ones(3), _LUMA)) @ matrix
        if self.hue:
            angle = 2 * np.pi * self.hue * hue
            turn = np.array(
                [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
            )
            matrix = np.linalg.solve(_YIQ, turn @ _YIQ) @ matrix
        c = 1 + self.contrast * contrast
        offset = (1 - c) * float(_LUMA @ matrix @ mean)
        return np.column_stack([c * matrix, np.full(3, offset)])


def check_probabilities(options: object, *names: str) -> None:
    """Raises a ValueError for the first attribute of `options` among `names` that is no probability."""
    for name in names:
        value = getattr(options, name)
        if not 0 <= value <= 1:
            raise ValueError(f"{name} is {value}, but must be a probability in 0..1.")


def cast_shadows(image: Image, rng: np.random.Generator) -> Image:
    """Darkens one to three random polygons with soft edges, as bridges, trees and cars do."""
    height, width = image.shape[0] // 4 + 1, image.shape[1] // 4 + 1
    light = np.full((height, width), 255, np.uint8)
    for _ in range(rng.integers(1, 4)):
        corners = rng.uniform(-0.2, 1.2, 2) + rng.uniform(-0.5, 0.5, (int(rng.integers(3, 7)), 2))
        polygon = cv2.convexHull(np.rint(corners * (width, height)).astype(np.int32))
        cv2.fillConvexPoly(light, polygon, int(255 * rng.uniform(0.35, 0.8)), cv2.LINE_AA)
    soft = int(rng.integers(0, 4)) * 2 + 1
    light = cv2.resize(cv2.blur(light, (soft, soft)), image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.multiply(image, cv2.merge([light] * 3), scale=1 / 255))


def add_glare(image: Image, rng: np.random.Generator) -> Image:
    """Adds a glow around a random point, as a low sun or a wet road does, that fades to the sides."""
    height, width = image.shape[0] // 8 + 1, image.shape[1] // 8 + 1
    center = rng.uniform(0, 1, 2) * (width, height)
    radius = rng.uniform(0.15, 0.7) * width * rng.uniform(0.5, 1.5, 2)
    x = np.exp(-(((np.arange(width) - center[0]) / radius[0]) ** 2))
    y = np.exp(-(((np.arange(height) - center[1]) / radius[1]) ** 2))
    glow = np.rint(rng.uniform(30, 150) * y[:, None] * x).astype(np.uint8)
    glow = cv2.resize(glow, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.add(image, cv2.merge([glow] * 3)))


def blur(image: Image, rng: np.random.Generator) -> Image:
    """Blurs as a lens out of focus or, half of the time, vertically as a moving camera does."""
    if rng.random() < 0.5:
        sigma = rng.uniform(0.4, 1.5)
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma))
    return np.asarray(cv2.blur(image, (1, int(rng.integers(2, 6)))))


def add_noise(image: Image, rng: np.random.Generator) -> Image:
    """Adds uniform pixel noise of a random strength up to +-20 gray values."""
    noise = np.frombuffer(rng.bytes(image.size), np.uint8).reshape(image.shape)
    strength = rng.uniform(2, 20) / 127.5
    return np.asarray(cv2.addWeighted(image, 1.0, noise, strength, -127.5 * strength))


def compress(image: Image, rng: np.random.Generator) -> Image:
    """Gives the image after JPEG compression of quality 25 to 80."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 81))])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))


def erase_rectangle(image: Image, rng: np.random.Generator, area: tuple[float, float]) -> Image:
    """Replaces a random rectangle by one random color with noise.

    Args:
        image: The image; it is not changed.
        rng: Source of randomness.
        area: Least and largest area as a fraction of the image.
    """
    height, width = image.shape[:2]
    pixels = rng.uniform(*area) * height * width
    aspect = np.exp(rng.uniform(np.log(0.3), np.log(3.3)))
    h = int(np.clip(round(np.sqrt(pixels * aspect)), 1, height))
    w = int(np.clip(round(pixels / h), 1, width))
    top, left = int(rng.integers(0, height - h + 1)), int(rng.integers(0, width - w + 1))
    patch = np.broadcast_to(rng.integers(0, 256, 3, np.uint8), (h, w, 3))
    image = image.copy()
    image[top : top + h, left : left + w] = add_noise(np.ascontiguousarray(patch), rng)
    return image
