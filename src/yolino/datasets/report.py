"""What `yolino.datasets.check` finds, as values; the command line prints them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

Size = tuple[int, int]

KINDS = {
    "broken label": "a label file, or an entry in one, cannot be read",
    "missing image": "the image does not exist",
    "unreadable image": "the image cannot be read",
    "wrong size": "an image has another size than its labels state",
    "not finite": "a vertex is NaN or infinite",
    "unknown label": "a label has no class name",
    "duplicate name": "a sample has the name of an earlier one",
    "duplicate polyline": "a polyline has the vertices of an earlier one of the same image",
    "near duplicate": "a polyline lies within 1 px of an earlier one, all along",
    "one vertex": "a polyline has fewer than two vertices",
    "zero length": "a polyline has no length",
    "repeated vertex": "a polyline has the same vertex several times in a row",
    "self-overlap": "a polyline crosses, touches or runs over itself",
    "outside": "a polyline lies wholly outside its image",
    "partly outside": "a polyline leaves its image",
    "other size": "an image has another size than most",
}
ERRORS = frozenset(
    {"broken label", "missing image", "unreadable image", "wrong size", "not finite", "unknown label"}
)
"""Kinds that training does not survive, or that put labels in the wrong place; the others are notices."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong, or at least worth a look.

    Attributes:
        kind: A key of `KINDS`.
        sample: Name of the sample; for a broken label the label file and the place in it.
        detail: Which polyline, vertex, file or number.
    """

    kind: str
    sample: str
    detail: str


class Picture(NamedTuple):
    """The image of a sample.

    Attributes:
        name: Name of the sample.
        file: The image file; None for pixels that are in memory.
    """

    name: str
    file: Path | None


@dataclass(frozen=True)
class Occupancy:
    """How many segments the cells of one stride hold.

    Attributes:
        stride: Side of a cell in pixels.
        predictors: Predictors per cell (the paper's P).
        segments: Segments of all samples.
        cells: Cells of all samples that hold any.
        fullest: Largest number of segments in one cell.
        surplus: Segments that find no predictor.
    """

    stride: int
    predictors: int
    segments: int = 0
    cells: int = 0
    fullest: int = 0
    surplus: int = 0

    def __add__(self, other: Occupancy) -> Occupancy:
        """Gives the occupancy of the samples of both."""
        assert (self.stride, self.predictors) == (other.stride, other.predictors)
        return Occupancy(
            self.stride,
            self.predictors,
            self.segments + other.segments,
            self.cells + other.cells,
            max(self.fullest, other.fullest),
            self.surplus + other.surplus,
        )


@dataclass(frozen=True)
class Report:
    """What `check` found.

    Attributes:
        samples: Number of samples.
        polylines: Number of polylines.
        vertices: Number of vertices.
        sizes: Number of images of each `(height, width)`, the most frequent first.
        class_counts: Number of polylines of each class.
        findings: All findings, what is broken first, then in the order of the samples.
        occupancy: One entry for each stride.
        left_out: Number of polylines of each name that is not among the classes.
        pictures: The images of the samples, in their order.
    """

    samples: int
    polylines: int
    vertices: int
    sizes: dict[Size, int]
    class_counts: dict[str, int]
    findings: tuple[Finding, ...]
    occupancy: tuple[Occupancy, ...]
    left_out: Mapping[str, int] = field(default_factory=dict)
    pictures: tuple[Picture, ...] = ()

    @property
    def counts(self) -> dict[str, int]:
        """Number of findings of each kind that was found."""
        counts = Counter(finding.kind for finding in self.findings)
        return {kind: counts[kind] for kind in KINDS if counts[kind]}

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings of the kinds in `ERRORS`."""
        return tuple(finding for finding in self.findings if finding.kind in ERRORS)

    def to_document(self) -> dict[str, Any]:
        """Gives all but the pictures as values that JSON knows."""
        return {
            "samples": self.samples,
            "polylines": self.polylines,
            "vertices": self.vertices,
            "sizes": [{"size": list(size), "images": count} for size, count in self.sizes.items()],
            "classes": self.class_counts,
            "left_out": dict(self.left_out),
            "occupancy": [asdict(one) for one in self.occupancy],
            "counts": self.counts,
            "errors": len(self.errors),
            "findings": [asdict(finding) for finding in self.findings],
        }


@dataclass(frozen=True)
class DeviationRow:
    """What the cells of one stride cost, averaged over the samples.

    Attributes:
        stride: Side of a cell in pixels.
        border_px: Deviation where segments run from border to border (1D, Eu; the paper's table), in pixels.
        points_px: Deviation where loose ends stay (Po), in pixels.
        segments: Segments from border to border, of all samples.
        lost: Polylines of all samples that leave no segment from border to border.
    """

    stride: int
    border_px: float
    points_px: float
    segments: int
    lost: int


__all__ = ["ERRORS", "KINDS", "DeviationRow", "Finding", "Occupancy", "Picture", "Report", "Size"]
