"""What the camera makes of the scene: roll, glare, vignetting, exposure, color, blur, noise, JPEG."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

from yolino.datasets.road.drawing import Canvas, fill
from yolino.datasets.texture import crop
from yolino.types import Floats


def roll_matrix(size: tuple[int, int], margin: int, angle: float) -> Float[np.ndarray, "3 3"]:
    """Gives the matrix from the canvas with its margin to the picture, turned by `angle` (radians)."""
    h, w = size
    c, s = np.cos(angle), np.sin(angle)
    x, y = w / 2, h / 2
    cx, cy = x + margin, y + margin
    return np.array([[c, -s, x - c * cx + s * cy], [s, c, y - s * cx - c * cy], [0, 0, 1]])


def turn(canvas: Canvas, matrix: Floats, size: tuple[int, int]) -> Canvas:
    """Gives the picture of `size` that `matrix` (between continuous pixels) takes from the canvas."""
    h, w = size
    if matrix[0, 1] == 0:
        x, y = (round(-v) for v in matrix[:2, 2])
        return canvas[y : y + h, x : x + w].copy()
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    pixels = np.linalg.inv(half) @ matrix @ half
    four = cv2.cvtColor(canvas, cv2.COLOR_RGB2RGBA)  # four channels are warped twice as fast as three
    warped = cv2.warpAffine(four, pixels[:2], (w, h), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.cvtColor(warped, cv2.COLOR_RGBA2RGB), dtype=np.uint8)


def expose(image: Canvas, rng: np.random.Generator) -> Canvas:
    """Gives the image as a random camera would take it, through a windscreen and over a bonnet."""
    w = image.shape[1]
    if rng.random() < 0.5:
        image = np.asarray(
            cv2.GaussianBlur(image, (0, 0), rng.uniform(0.25, 0.75) * max(w / 640, 0.5)), dtype=np.uint8
        )
    image = _light(image, rng)
    if rng.random() < 0.4:
        _bonnet(image, rng)
    image = cv2.LUT(image, _curve(rng))
    image = _grain(image, rng.exponential(1.2), rng)
    if rng.random() < 0.35:
        _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(50, 95))])
        image = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), dtype=np.uint8)
    return np.asarray(image, dtype=np.uint8)


def _bonnet(image: Canvas, rng: np.random.Generator) -> None:
    """Darkens the lowest rows: the edge of the own car, seldom straight."""
    h, w = image.shape[:2]
    tall = w * (rng.uniform(0.0, 0.012) if rng.random() < 0.75 else rng.uniform(0.01, 0.035))
    x = np.linspace(-0.1, 1.1, 9)
    y = (
        h
        - tall
        + w * (rng.normal(0, 0.006) * (x - 0.5) + rng.uniform(0, 0.03) * (x - rng.uniform(0.3, 0.7)) ** 2)
    )
    outline = np.concatenate(
        [np.stack([x * w, y], axis=1), [(1.2 * w, 1.5 * h + 9), (-0.2 * w, 1.5 * h + 9)]]
    )
    gray = rng.uniform(4, 60)
    fill(image, outline, (gray, gray, gray * 1.05))


def _light(image: Canvas, rng: np.random.Generator) -> Canvas:
    """Applies white balance, vignetting, stains on the windscreen and, rarely, the veil of a low sun."""
    h, w = image.shape[:2]
    y, x = np.linspace(-1, 1, 18)[:, None], np.linspace(-1, 1, 32)[None]
    gain = 1 - rng.uniform(0, 0.3) * (x**2 + y**2) / 2
    if rng.random() < 0.12:
        spot = (x - rng.uniform(-1, 1)) ** 2 + (y + rng.uniform(0, 1)) ** 2
        gain = gain + rng.uniform(0.2, 0.9) * np.exp(-spot / rng.uniform(0.1, 0.6))
    for _ in range(rng.poisson(0.3)):
        spot = ((x - rng.uniform(-1, 1)) * 1.8) ** 2 + (y - rng.uniform(-1, 0.6)) ** 2
        gain = gain * (1 - rng.uniform(0.1, 0.4) * np.exp(-spot / rng.uniform(0.005, 0.03)))
    balance = rng.normal(1, 0.015, 3) + rng.normal(0, 0.025) * np.array((1, 0, -1))
    small = np.clip(gain[..., None] * (balance * 128), 0, 255).astype(np.uint8)
    full = cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.multiply(image, full, scale=1 / 128), dtype=np.uint8)


def _curve(rng: np.random.Generator) -> Canvas:
    """Gives the table of exposure, gamma and contrast."""
    value = np.arange(256) / 255
    out = rng.uniform(0.8, 1.25) * value ** rng.uniform(0.85, 1.25)
    curve = rng.uniform(0, 0.6)
    smooth = np.clip(out, 0, 1)
    out = (1 - curve) * out + curve * smooth**2 * (3 - 2 * smooth)
    out = out + rng.uniform(0, 0.05) * (1 - out)
    return np.clip(out * 255, 0, 255).astype(np.uint8)


def _grain(image: Canvas, amount: float, rng: np.random.Generator) -> Canvas:
    """Adds the noise of the sensor, the same in all channels."""
    middle = 3.0 * amount
    grain = cv2.convertScaleAbs(crop(0.0, image.shape[:2], rng, tile=1024) + np.float32(3), alpha=amount)
    noisy = cv2.addWeighted(image, 1.0, cv2.cvtColor(grain, cv2.COLOR_GRAY2RGB), 1.0, -middle)
    return np.asarray(noisy, dtype=np.uint8)
