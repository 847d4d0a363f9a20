"""`yolino datasets check`: mistakes in images and labels, how full cells are, what splits have in common."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from yolino.cli.frames import Fit, Size, Strides, frame_arguments
from yolino.cli.options import AsJson, Data, DatasetName, Labels, More, Root, Split

if TYPE_CHECKING:
    from yolino.cli.labels import Selection
    from yolino.datasets.leaks import Comparison, Leak
    from yolino.datasets.report import Finding, Report

EPILOG = """
**Examples**

- `yolino datasets check --data drive.yaml` examines all splits, and looks for images that are in two of them

- `yolino datasets check --root data/tusimple --details` lists all that is wrong, file by file

- `yolino datasets check --data drive.yaml --by 2 --json` tells a script, and takes two folders for a drive
"""
FIRST, ERRORS_SHOWN = 3, 20
WHOLE = "all"
Reports = Mapping[str, "Report"]


def add_to(group: typer.Typer) -> None:
    """Adds the command."""
    group.command(epilog=EPILOG)(check)


def check(
    *,
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    stride: Strides = [32, 16, 8],  # noqa: B006 (typer reads it, nobody changes it)
    predictors: Annotated[int, typer.Option("--predictors", min=1, help="Predictors per cell.")] = 8,
    size: Size = None,
    fit: Fit = "bottom",
    by: Annotated[
        str,
        typer.Option(
            "--by", metavar="auto|image|folder|N|regex:...", help="What must not be in two splits: see split."
        ),
    ] = "auto",
    images: Annotated[
        bool, typer.Option("--images/--no-images", help="Look for nearly identical images in two splits.")
    ] = True,
    details: Annotated[bool, typer.Option("--details", help="List every finding, file by file.")] = False,
    as_json: AsJson = False,
) -> None:
    """Look for mistakes in images and labels and between splits; exit code 2 if training is at risk."""
    import json

    from yolino.cli.labels import Selection
    from yolino.cli.screen import report_problems, track
    from yolino.datasets.leaks import find_leaks

    chosen = Selection(data, split, dataset, root, labels or (), option or ())
    reports = _examine(chosen, stride, predictors, frame_arguments(size, fit))
    pictures = {name: report.pictures for name, report in reports.items()}
    progress = partial(track, title="comparing images")
    comparison = find_leaks(pictures, by=by, decode=images, progress=progress)
    reports = _with_unreadable(reports, comparison)
    if as_json:
        typer.echo(json.dumps(_document(reports, comparison)))
    else:
        _print(reports, comparison, details)
        if len(reports) > 1 and not comparison.leaks:
            seen = "image" if not images else "image, no nearly identical one"
            typer.echo(f"Nothing leaks: no {seen} and no clip is in two splits.")
    if len({tuple(report.class_counts) for report in reports.values()}) > 1:
        typer.echo("The splits have different classes: name them under `classes:` in data.yaml.", err=True)
    errors = _errors(reports, comparison)
    with report_problems(errors[:ERRORS_SHOWN]):
        if len(errors) > ERRORS_SHOWN:
            typer.echo(f"{len(errors)} errors, the first {ERRORS_SHOWN} below.", err=True)


def _examine(
    chosen: Selection, strides: Sequence[int], predictors: int, frame: dict[str, Any]
) -> dict[str, Report]:
    """Gives the report of each split, or of the whole dataset where there are none."""
    from yolino.cli.labels import open_dataset
    from yolino.cli.screen import counted, track
    from yolino.datasets.check import check as run

    reports = {}
    for name in _splits(chosen):
        what = f" {name}" if name else ""
        samples = open_dataset(chosen._replace(split=name), lenient=True, progress=counted(f"reading{what}"))
        progress = partial(track, title=f"checking{what}")
        reports[name or WHOLE] = run(samples, strides, predictors, progress=progress, **frame)
    return reports


def _splits(chosen: Selection) -> list[str] | list[None]:
    """Gives the splits that are examined; None is the whole dataset."""
    from yolino.datasets.description import load_description

    if chosen.split is not None:
        return [chosen.split]
    if chosen.data is None or chosen.labels:
        return [None]
    return list(load_description(chosen.data).splits) or [None]


def _with_unreadable(reports: Reports, comparison: Comparison) -> dict[str, Report]:
    """Gives the reports with the images that turned out to be broken when they were decoded."""
    from dataclasses import replace

    found = dict(reports)
    for name, finding in comparison.unreadable:
        findings = found[name].findings
        if not any((one.kind, one.sample) == (finding.kind, finding.sample) for one in findings):
            found[name] = replace(found[name], findings=(*findings, finding))
    return found


def _document(reports: Reports, comparison: Comparison) -> dict[str, Any]:
    """Gives all that was found as values that JSON knows."""
    from dataclasses import asdict

    return {
        "splits": {name: report.to_document() for name, report in reports.items()},
        "leaks": {
            "counts": comparison.counts,
            "found": [asdict(leak) for leak in comparison.leaks],
            "not_compared": list(comparison.collections),
        },
        "errors": len(_errors(reports, comparison)),
    }


def _errors(reports: Reports, comparison: Comparison) -> list[str]:
    found = [line for name, report in reports.items() for line in _lines(reports, name, report.errors)]
    return found + [_leak_line(leak) for leak in comparison.errors]


def _lines(reports: Reports, name: str, findings: Iterable[Finding]) -> Iterator[str]:
    """Yields findings as lines, with the split if there are several."""
    split = f"{name}: " if len(reports) > 1 else ""
    for one in findings:
        yield f"{split}{one.sample}: {one.kind}" + (f", {one.detail}" if one.detail else "")


def _leak_line(leak: Leak) -> str:
    both = ", ".join(f"{split} {name}" for split, name in zip(leak.splits, leak.samples, strict=True))
    return f"{both}: {leak.kind}" + (f", {leak.detail}" if leak.detail else "")


def _print(reports: Reports, comparison: Comparison, details: bool) -> None:
    _print_counts(reports)
    _print_cells(reports)
    _print_findings(reports, details)
    _print_leaks(comparison, details)


def _print_counts(reports: Reports) -> None:
    from yolino.cli.screen import print_table

    every = list(reports.values())
    classes = dict.fromkeys(name for report in every for name in report.class_counts)
    left_out = dict.fromkeys(name for report in every for name in report.left_out)
    rows: list[tuple[object, ...]] = [
        ("samples", *(report.samples for report in every)),
        ("polylines", *(report.polylines for report in every)),
        ("vertices", *(report.vertices for report in every)),
        ("sizes, height x width (images)", *(_sizes(report) or "none" for report in every)),
    ]
    rows += [
        (f"polylines of class {name}", *(report.class_counts.get(name, 0) for report in every))
        for name in classes
    ]
    rows += [
        (f"polylines of {name}, left out", *(report.left_out.get(name, 0) for report in every))
        for name in left_out
    ]
    print_table(("what", *(reports if len(reports) > 1 else ("count",))), rows)


def _sizes(report: Report) -> str:
    sizes = [f"{height}x{width} ({count})" for (height, width), count in report.sizes.items()]
    return ", ".join(sizes[:FIRST]) + (f", and {len(sizes) - FIRST} more" if len(sizes) > FIRST else "")


def _print_cells(reports: Reports) -> None:
    from yolino.cli.screen import print_table

    header = ("stride", "predictors", "segments", "cells", "fullest cell", "surplus segments")
    rows = [
        (f"{o.stride} {name}" if len(reports) > 1 else o.stride, *_cells(o))
        for name, report in reports.items()
        for o in report.occupancy
    ]
    print_table(header, rows, title="Cells")


def _cells(one: Any) -> tuple[int, ...]:
    return one.predictors, one.segments, one.cells, one.fullest, one.surplus


def _print_findings(reports: Reports, details: bool) -> None:
    from yolino.cli.screen import print_table
    from yolino.datasets.report import ERRORS, KINDS

    counts = [report.counts for report in reports.values()]
    kinds = [kind for kind in KINDS if any(kind in count for count in counts)]
    if not kinds:
        typer.echo("Nothing is wrong.")
        return
    rows = []
    for kind in kinds:
        weight = "error" if kind in ERRORS else "notice"
        rows.append((kind, weight, KINDS[kind], *(count.get(kind, 0) for count in counts)))
    columns = tuple(reports) if len(reports) > 1 else ("count",)
    print_table(("finding", "weight", "meaning", *columns), rows, title="Findings")
    for name, report in reports.items():
        of_kind = [[one for one in report.findings if one.kind == kind] for kind in kinds]
        few = [one for some in of_kind for one in some[:FIRST]]
        _print_lines([*_lines(reports, name, report.findings if details else few)], len(report.findings))


def _print_leaks(comparison: Comparison, details: bool) -> None:
    from yolino.cli.screen import print_table
    from yolino.datasets.leaks import LEAK_ERRORS, LEAKS

    for name in comparison.collections:
        typer.echo(f"The split {name} consists of other splits and is not compared with them.")
    if not comparison.leaks:
        return
    rows = [
        (kind, "error" if kind in LEAK_ERRORS else "notice", LEAKS[kind], count)
        for kind, count in comparison.counts.items()
    ]
    print_table(("leak", "weight", "meaning", "count"), rows, title="Leaks")
    of_kind = [[one for one in comparison.leaks if one.kind == kind] for kind in comparison.counts]
    few = [one for some in of_kind for one in some[:FIRST]]
    _print_lines([_leak_line(one) for one in (comparison.leaks if details else few)], len(comparison.leaks))


def _print_lines(lines: Sequence[str], total: int) -> None:
    for line in lines:
        typer.echo(line)
    if len(lines) < total:
        typer.echo(f"... and {total - len(lines)} more: --details lists them.")


__all__ = ["add_to", "check"]
