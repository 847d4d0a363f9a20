"""Which lanes a scene has: where the boundaries run, how they are marked, and which of them are labelled."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from yolino.datasets.road.drawing import Color
from yolino.types import Floats

WHITE = (232, 232, 226)
YELLOW = (226, 160, 38)


@dataclass(frozen=True)
class Pattern:
    """Where along the road a stripe is painted.

    Attributes:
        period: Length in meters after which the pattern repeats; 0 is continuous.
        pieces: Painted stretches of one period, each from its start to its end in meters.
        phase: Distance in meters by which the pattern is shifted.
    """

    period: float = 0.0
    pieces: tuple[tuple[float, float], ...] = ()
    phase: float = 0.0

    def painted(self, z: Floats) -> Floats:
        """Gives the painted length in meters between 0 and `z`."""
        if self.period <= 0:
            return z
        knots = np.array([0.0, *(end for piece in self.pieces for end in piece), self.period])
        length = np.concatenate([[0.0], np.cumsum(np.diff(knots) * (np.arange(len(knots) - 1) % 2))])
        turns, rest = np.divmod(z - self.phase, self.period)
        return np.asarray(turns * length[-1] + np.interp(rest, knots, length))

    def share(self, edges: Floats) -> Floats:
        """Gives the painted share of each stretch between consecutive distances `edges`, which decrease."""
        return np.asarray(np.diff(self.painted(edges)) / np.minimum(np.diff(edges), -1e-9))


@dataclass(frozen=True)
class Stripe:
    """One painted stripe along the road.

    Attributes:
        shift: Distance of its middle from the boundary that it marks, in meters to the right.
        width: Its width in meters.
        color: Its color, RGB.
        pattern: Where along the road it is painted.
        opacity: How much of the road it hides, at most 1.
        wear: How patchy it is, from 0 to 1.
        raised: Whether it is made of raised dots.
    """

    width: float
    color: Color
    shift: float = 0.0
    pattern: Pattern = Pattern()
    opacity: float = 0.95
    wear: float = 0.0
    raised: bool = False


@dataclass(frozen=True)
class Boundary:
    """A lane boundary: a line along the road, with the stripes that mark it.

    Attributes:
        offset: Distance from the axis of the own lane in meters, positive to the right.
        label: Index in `yolino.datasets.tusimple.CLASSES`.
        stripes: What is painted for it.
        taper: From which distance in meters on it leaves its offset (for an exit, say), and by how many
            meters per meter.
    """

    offset: float
    label: int
    stripes: tuple[Stripe, ...]
    taper: tuple[float, float] = (0.0, 0.0)

    def run(self, z: Floats) -> Floats:
        """Gives its lateral position at distance `z`, both in meters."""
        start, rate = self.taper
        beyond = np.maximum(z - start, 0)
        return np.asarray(self.offset + rate * beyond**2 / (beyond + 15))


@dataclass(frozen=True)
class Layout:
    """The lanes of a scene.

    Attributes:
        boundaries: From left to right.
        own: Index of the boundary that is left of the camera's own lane.
        shoulders: Width in meters of the paved shoulder left and right.
        lane_width: Typical lane width in meters.
    """

    boundaries: tuple[Boundary, ...]
    own: int
    shoulders: tuple[float, float]
    lane_width: float

    @property
    def edges(self) -> tuple[float, float]:
        """Lateral positions in meters where the pavement ends left and right."""
        return self.boundaries[0].offset - self.shoulders[0], self.boundaries[-1].offset + self.shoulders[1]


def _dash(rng: np.random.Generator) -> Pattern:
    period, length = ((14.63, 3.66), (12.19, 3.05), (12.19, 3.05), (9.0, 3.0), (3.66, 0.91))[
        rng.choice(5, p=[0.45, 0.2, 0.15, 0.12, 0.08])
    ]
    period *= rng.uniform(0.96, 1.04)
    return Pattern(period, ((0.0, length),), rng.uniform(0, period))


def _dots(rng: np.random.Generator) -> Pattern:
    """Groups of one to five round dots of about 10 cm."""
    period = rng.choice([7.3, 14.63, 14.63, 12.2])
    spacing = rng.uniform(0.8, 1.3)
    count = int(rng.integers(1, 6))
    return Pattern(
        float(period), tuple((i * spacing, i * spacing + 0.14) for i in range(count)), rng.uniform(0, period)
    )


def _look(rng: np.random.Generator, color: Color) -> dict[str, object]:
    """Gives color, opacity and wear of one paint: most are good, some worn, a few nearly gone."""
    tint = np.array(color) * rng.uniform(0.85, 1.0) + rng.normal(0, 5, 3)
    state = rng.choice(3, p=[0.62, 0.28, 0.1])
    opacity = (rng.uniform(0.85, 1), rng.uniform(0.5, 0.9), rng.uniform(0.08, 0.4))[state]
    wear = (rng.uniform(0, 0.25), rng.uniform(0.2, 0.8), rng.uniform(0.3, 0.9))[state]
    return {"color": tuple(tint), "opacity": float(opacity), "wear": float(wear)}


def _double(rng: np.random.Generator, stripe: Stripe) -> tuple[Stripe, Stripe]:
    gap = stripe.width + rng.uniform(0.07, 0.2)
    return replace(stripe, shift=-gap / 2), replace(stripe, shift=gap / 2)


def _stripes(rng: np.random.Generator, label: int) -> tuple[Stripe, ...]:
    """Gives what is painted for a boundary of class `label`."""
    yellow = label in (0, 5)
    width = rng.uniform(0.1, 0.17) * (rng.uniform(1.4, 2.0) if rng.random() < 0.1 else 1.0)
    stripe = Stripe(width, **_look(rng, YELLOW if yellow else WHITE))  # type: ignore[arg-type]
    if label in (0, 1):
        return (stripe,)
    if label == 5:
        return _double(rng, stripe)
    if label == 4:
        return _dotted(rng, stripe)
    if label == 6:
        return (replace(stripe, opacity=rng.uniform(0.0, 0.12)),) if rng.random() < 0.5 else ()
    dashed = replace(stripe, pattern=_dash(rng))
    stripes = (dashed,) if label == 2 else _double(rng, dashed)
    if rng.random() < 0.6 and dashed.pattern.period > 6:
        middle = (dashed.pattern.period + dashed.pattern.pieces[0][1]) / 2
        reflector = replace(dashed.pattern, pieces=((middle, middle + 0.12),))
        stripes = (
            *stripes,
            replace(stripe, width=0.12, pattern=reflector, opacity=0.9, wear=0.0, raised=True),
        )
    return stripes


def _dotted(rng: np.random.Generator, stripe: Stripe) -> tuple[Stripe, ...]:
    dots = replace(
        stripe,
        width=rng.uniform(0.1, 0.15),
        pattern=_dots(rng),
        opacity=rng.uniform(0.6, 1),
        wear=0.0,
        raised=True,
    )
    return _double(rng, dots) if rng.random() < 0.08 else (dots,)


def _labels(rng: np.random.Generator, lanes: int) -> list[int]:
    """Gives a class for each of the `lanes + 1` boundaries, from left to right, as highways have them."""
    inner = int(rng.choice([2, 4, 3, 1], p=[0.5, 0.4, 0.06, 0.04]))
    labels = [inner] * (lanes + 1)
    labels[0] = int(rng.choice([0, 5, 1, 4, 2, 6], p=[0.62, 0.1, 0.12, 0.05, 0.06, 0.05]))
    labels[-1] = int(rng.choice([1, 0, 2, 4, 6], p=[0.78, 0.03, 0.1, 0.03, 0.06]))
    if lanes > 2 and rng.random() < 0.15:
        labels[1] = int(rng.choice([5, 1, 3, 2]))
    if lanes > 2 and rng.random() < 0.15:
        labels[-2] = int(rng.choice([1, 3, 2, 4]))
    return labels


def sample_layout(rng: np.random.Generator) -> Layout:
    """Gives random lanes around the camera."""
    lanes = int(rng.choice([1, 2, 3, 4, 5], p=[0.06, 0.3, 0.27, 0.24, 0.13]))
    own = int(rng.integers(0, lanes))
    width = rng.normal(3.62, 0.13)
    widths = width + rng.normal(0, 0.05, lanes)
    offsets = np.concatenate([[0.0], np.cumsum(widths)])
    offsets -= (offsets[own] + offsets[own + 1]) / 2
    boundaries = [
        Boundary(float(offset), label, _stripes(rng, label))
        for offset, label in zip(offsets, _labels(rng, lanes), strict=True)
    ]
    shoulders = (rng.uniform(0.3, 4.5), rng.uniform(0.5, 5.0))
    if rng.random() < 0.12:
        taper = (rng.uniform(5, 50), rng.uniform(0.02, 0.1))
        boundaries[-1] = replace(boundaries[-1], taper=taper)
        shoulders = (shoulders[0], rng.uniform(5, 12))
    return Layout(tuple(boundaries), own, shoulders, width)
