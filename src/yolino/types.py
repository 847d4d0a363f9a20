"""The values that every room speaks in: segments, polylines, cell segments and samples.

All are frozen and made of numpy arrays. They know no file format and draw nothing. The frame is image pixels
unless a name says otherwise (`docs/conventions.md`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Index = NDArray[np.bool_] | NDArray[np.integer] | slice


def _floats(values: ArrayLike, shape: tuple[int, ...], name: str) -> Floats:
    """Gives `values` as float64 of `shape` (-1 is free); an empty list takes the shape with zero rows."""
    array: Floats = np.asarray(values, dtype=np.float64)
    if array.shape == (0,):
        array = array.reshape(tuple(max(s, 0) for s in shape))
    if array.ndim != len(shape) or any(s not in (-1, n) for s, n in zip(shape, array.shape, strict=True)):
        want = ", ".join("n" if s == -1 else str(s) for s in shape)
        raise ValueError(f"{name} has shape {array.shape}, but ({want}) is needed.")
    return array


def _per_item(
    values: ArrayLike | None, n: int, *, default: int, name: str, dtype: type
) -> NDArray[np.generic]:
    array: NDArray[np.generic] = (
        np.full(n, default, dtype) if values is None else np.asarray(values, dtype=dtype)
    )
    if array.shape != (n,):
        raise ValueError(
            f"{name} has shape {array.shape}, but one value for each of the {n} items is needed: ({n},)."
        )
    return array


def _shares(values: ArrayLike | None, n: int, items: str) -> Floats | None:
    """Gives class probabilities as float64, or None where there are none."""
    if values is None:
        return None
    shares = _floats(values, (-1, -1), "probabilities")
    if len(shares) != n:
        raise ValueError(f"probabilities has {len(shares)} rows, but there are {n} {items}.")
    return shares


@dataclass(frozen=True, eq=False, init=False)
class Segments:
    """Directed line segments in image pixels: what crosses the seam between network and post-processing.

    Attributes:
        endpoints: Start and end point of each segment, `(x, y)` in pixels.
        scores: Confidence of each segment, 1 where none is given.
        labels: Class index of each segment, 0 where none is given.
        probabilities: Class probabilities, or None where the source knows no classes.
    """

    endpoints: Float[np.ndarray, "n 2 2"]
    scores: Float[np.ndarray, " n"]
    labels: Int[np.ndarray, " n"]
    probabilities: Float[np.ndarray, "n c"] | None

    def __init__(
        self,
        endpoints: ArrayLike,
        scores: ArrayLike | None = None,
        labels: ArrayLike | None = None,
        probabilities: ArrayLike | None = None,
    ) -> None:
        points = _floats(endpoints, (-1, 2, 2), "endpoints")
        n = len(points)
        shares = _shares(probabilities, n, "segments")
        if labels is None and shares is not None and shares.shape[1]:
            labels = shares.argmax(axis=1)
        object.__setattr__(self, "endpoints", points)
        object.__setattr__(self, "scores", _per_item(scores, n, default=1, name="scores", dtype=np.float64))
        object.__setattr__(self, "labels", _per_item(labels, n, default=0, name="labels", dtype=np.int64))
        object.__setattr__(self, "probabilities", shares)

    @classmethod
    def trusted(cls, endpoints: Floats, scores: Floats, labels: Ints, shares: Floats | None) -> Segments:
        """Gives the segments of arrays that fit by their making: nothing is looked at, converted or copied.

        For what our kernels give: when caches are cold, right after a network, the checks take as long.
        """
        made = object.__new__(cls)
        made.__dict__.update(endpoints=endpoints, scores=scores, labels=labels, probabilities=shares)
        return made

    def __len__(self) -> int:
        return len(self.endpoints)

    def __getitem__(self, index: Index) -> Segments:
        probabilities = None if self.probabilities is None else self.probabilities[index]
        return Segments(self.endpoints[index], self.scores[index], self.labels[index], probabilities)

    @property
    def starts(self) -> Float[np.ndarray, "n 2"]:
        """Start points in pixels."""
        return self.endpoints[:, 0]

    @property
    def ends(self) -> Float[np.ndarray, "n 2"]:
        """End points in pixels."""
        return self.endpoints[:, 1]

    @property
    def midpoints(self) -> Float[np.ndarray, "n 2"]:
        """Midpoints in pixels."""
        return np.asarray(self.endpoints.mean(axis=1))

    @property
    def lengths(self) -> Float[np.ndarray, " n"]:
        """Lengths in pixels."""
        delta = self.endpoints[:, 1] - self.endpoints[:, 0]
        return np.asarray(np.hypot(delta[:, 0], delta[:, 1]))

    def with_endpoints(self, endpoints: Float[np.ndarray, "n 2 2"]) -> Segments:
        """Gives the same segments with other end points (another frame, say)."""
        points = _floats(endpoints, (-1, 2, 2), "endpoints")
        if len(points) != len(self):
            raise ValueError(f"endpoints has {len(points)} rows, but there are {len(self)} segments.")
        return Segments.trusted(points, self.scores, self.labels, self.probabilities)


class Output(NamedTuple):
    """What a network says about a batch: all its n predictors, before any threshold.

    Attributes:
        endpoints: Start and end points in pixels of the network's input.
        scores: Confidence of each segment.
        probabilities: Class probabilities, None for a network without classes.
    """

    endpoints: Float32[np.ndarray, "b n 2 2"]
    scores: Float32[np.ndarray, "b n"]
    probabilities: Float32[np.ndarray, "b n c"] | None


@dataclass(frozen=True, eq=False, init=False)
class Polylines:
    """Directed polylines in image pixels as one ragged array, the GeoArrow layout.

    Polyline `i` has the vertices `vertices[offsets[i]:offsets[i + 1]]`. A branching shape is several
    polylines that share an end vertex. Iterating yields the `(v, 2)` vertex array of each polyline.

    Attributes:
        vertices: All vertices, `(x, y)` in pixels, one polyline after the other.
        offsets: Where each polyline begins in `vertices`, and the end of the last.
        scores: Confidence of each polyline, 1 where none is given.
        labels: Class index of each polyline, 0 where none is given.
        probabilities: Class probabilities of each polyline, or None where the source knows no classes.
    """

    vertices: Float[np.ndarray, "v 2"]
    offsets: Int[np.ndarray, " n_plus_1"]
    scores: Float[np.ndarray, " n"]
    labels: Int[np.ndarray, " n"]
    probabilities: Float[np.ndarray, "n c"] | None

    def __init__(
        self,
        vertices: ArrayLike,
        offsets: ArrayLike = (0,),
        scores: ArrayLike | None = None,
        labels: ArrayLike | None = None,
        probabilities: ArrayLike | None = None,
    ) -> None:
        points = _floats(vertices, (-1, 2), "vertices")
        bounds: Ints = np.asarray(offsets, dtype=np.int64)
        if bounds.ndim != 1 or len(bounds) == 0 or bounds[0] != 0 or bounds[-1] != len(points):
            raise ValueError(f"offsets must run from 0 to the {len(points)} vertices, got {bounds}.")
        if np.any(np.diff(bounds) < 0):
            raise ValueError(f"offsets must not decrease, got {bounds}.")
        n = len(bounds) - 1
        shares = _shares(probabilities, n, "polylines")
        if labels is None and shares is not None and shares.shape[1]:
            labels = shares.argmax(axis=1)
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "offsets", bounds)
        object.__setattr__(self, "scores", _per_item(scores, n, default=1, name="scores", dtype=np.float64))
        object.__setattr__(self, "labels", _per_item(labels, n, default=0, name="labels", dtype=np.int64))
        object.__setattr__(self, "probabilities", shares)

    @classmethod
    def trusted(
        cls, vertices: Floats, offsets: Ints, scores: Floats, labels: Ints, shares: Floats | None
    ) -> Polylines:
        """Gives the polylines of arrays that fit by their making, see `Segments.trusted`."""
        made = object.__new__(cls)
        made.__dict__.update(vertices=vertices, offsets=offsets, scores=scores, labels=labels)
        made.__dict__["probabilities"] = shares
        return made

    @classmethod
    def from_list(
        cls, lines: Iterable[ArrayLike], scores: ArrayLike | None = None, labels: ArrayLike | None = None
    ) -> Polylines:
        """Gives the polylines whose vertices are the `(v, 2)` arrays of `lines`."""
        arrays = [_floats(line, (-1, 2), "a polyline") for line in lines]
        offsets = np.cumsum([0, *(len(a) for a in arrays)])
        vertices = np.concatenate(arrays) if arrays else np.zeros((0, 2))
        return cls(vertices, offsets, scores, labels)

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __iter__(self) -> Iterator[Float[np.ndarray, "v 2"]]:
        for start, stop in zip(self.offsets[:-1], self.offsets[1:], strict=True):
            yield self.vertices[start:stop]

    def __getitem__(self, index: Index) -> Polylines:
        chosen = np.arange(len(self))[index]
        sizes = np.diff(self.offsets)[chosen]
        offsets = np.concatenate([[0], np.cumsum(sizes)])
        rows = np.arange(offsets[-1]) + np.repeat(self.offsets[:-1][chosen] - offsets[:-1], sizes)
        probabilities = None if self.probabilities is None else self.probabilities[chosen]
        return Polylines(
            self.vertices[rows], offsets, self.scores[chosen], self.labels[chosen], probabilities
        )

    @property
    def owners(self) -> Int[np.ndarray, " m"]:
        """Index of the polyline that each row of `endpoints` belongs to."""
        sizes = np.maximum(np.diff(self.offsets) - 1, 0)
        return np.repeat(np.arange(len(self)), sizes)

    @property
    def endpoints(self) -> Float[np.ndarray, "m 2 2"]:
        """The pieces between consecutive vertices, as start and end points in pixels."""
        starts = np.ones(len(self.vertices), np.bool_)
        ends = starts.copy()
        filled = np.diff(self.offsets) > 0
        starts[self.offsets[1:][filled] - 1] = False
        ends[self.offsets[:-1][filled]] = False
        return np.stack([self.vertices[starts], self.vertices[ends]], axis=1)

    @property
    def lengths(self) -> Float[np.ndarray, " n"]:
        """Arc lengths in pixels."""
        delta = np.diff(self.endpoints, axis=1)[:, 0]
        lengths = np.bincount(self.owners, np.hypot(delta[:, 0], delta[:, 1]), minlength=len(self))
        return lengths.astype(np.float64)  # without pieces, bincount counts in integers

    def with_vertices(self, vertices: Float[np.ndarray, "v 2"]) -> Polylines:
        """Gives the same polylines with other vertex positions (another frame, say)."""
        points = _floats(vertices, (-1, 2), "vertices")
        if len(points) != len(self.vertices):
            raise ValueError(f"vertices has {len(points)} rows, but there are {len(self.vertices)} vertices.")
        return Polylines.trusted(points, self.offsets, self.scores, self.labels, self.probabilities)


@dataclass(frozen=True, eq=False)
class CellSegments:
    """Directed segments in cell units, each in the frame of its cell: the cell is the unit square.

    Attributes:
        cells: Cell of each segment, `(row, column)`.
        endpoints: Start and end point, `(x, y)` in cell units, inside `[0, 1]`.
        labels: Class index of each segment.
        owners: Index of the polyline that each segment was cut from.
    """

    cells: Int[np.ndarray, "n 2"]
    endpoints: Float[np.ndarray, "n 2 2"]
    labels: Int[np.ndarray, " n"]
    owners: Int[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, index: Index) -> CellSegments:
        return CellSegments(self.cells[index], self.endpoints[index], self.labels[index], self.owners[index])


@dataclass(frozen=True, eq=False)
class Sample:
    """One annotated image.

    Attributes:
        name: Name of the sample, unique in its dataset (the path below the root, for files).
        image: The RGB pixels, or the file that holds them.
        polylines: The labels in image pixels.
        ignore: Polygons `(v, 2)` in pixels inside which nothing is labelled: neither trained nor scored.
        size: `(height, width)` of the image as the labels state it; None where they do not.
    """

    name: str
    image: Path | NDArray[np.uint8]
    polylines: Polylines
    ignore: Sequence[Float[np.ndarray, "_ 2"]] = ()
    size: tuple[int, int] | None = None


__all__ = ["CellSegments", "Floats", "Index", "Ints", "Output", "Polylines", "Sample", "Segments"]
