"""What `yolino.datasets.check` finds, as values; the command line prints them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

Size = tuple[int, int]

KINDS = {
    "missing image": "the image does not exist",
    "unreadable image": "the image cannot be read",
    "not finite": "a vertex is NaN or infinite",
    "unknown label": "a label has no class name",
    "duplicate name": "a sample has the name of an earlier one",
    "duplicate polyline": "a polyline has the vertices of an earlier one of the same image",
    "one vertex": "a polyline has fewer than two vertices",
    "zero length": "a polyline has no length",
    "outside": "a polyline lies wholly outside its image",
    "partly outside": "a polyline leaves its image",
    "other size": "an image has another size than most",
}
ERRORS = frozenset({"missing image", "unreadable image", "not finite", "unknown label"})
"""Kinds that training does not survive; the others cost nothing but labels."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or at least worth a look.

    Attributes:
        kind: A key of `KINDS`.
        sample: Name of the sample.
        detail: Which polyline, vertex, file or number.
    """

    kind: str
    sample: str
    detail: str


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
    segments: int
    cells: int
    fullest: int
    surplus: int


@dataclass(frozen=True)
class Report:
    """What `check` found.

    Attributes:
        samples: Number of samples.
        polylines: Number of polylines.
        vertices: Number of vertices.
        sizes: Number of images of each `(height, width)`, the most frequent first.
        class_counts: Number of polylines of each class.
        findings: All findings, in the order of the samples.
        occupancy: One entry for each stride.
    """

    samples: int
    polylines: int
    vertices: int
    sizes: dict[Size, int]
    class_counts: dict[str, int]
    findings: tuple[Finding, ...]
    occupancy: tuple[Occupancy, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Number of findings of each kind that was found."""
        counts = Counter(finding.kind for finding in self.findings)
        return {kind: counts[kind] for kind in KINDS if counts[kind]}

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that training does not survive."""
        return tuple(finding for finding in self.findings if finding.kind in ERRORS)


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


__all__ = ["ERRORS", "KINDS", "DeviationRow", "Finding", "Occupancy", "Report", "Size"]
