"""`yolino predict` on images: a result and a picture for each, in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer


def predict_images(
    sources: Sequence[str],
    *,
    model: str,
    threshold: float | None,
    out: Path,
    format: str,
    device: str,
    pictures: bool,
    view: str,
) -> None:
    """Finds the polylines in images; writes their results into a folder."""
    from yolino.cli.results import Found, ResultWriter, UnreadableError, predict_one, rows, summary
    from yolino.cli.screen import busy, print_table, report_problems, track
    from yolino.cli.sources import find_images, result_names
    from yolino.inference import load

    writer = ResultWriter(out, format, pictures=pictures, view=view)
    paths, problems = find_images(sources, excluded=out)
    names = result_names(paths)
    writer.refuse_overwriting(paths, names)
    with busy("loading the model (once after an installation, kernels are compiled: up to a minute)"):
        predictor = load(model, device=device, threshold=threshold)
        predictor.warm_up()
    found: list[Found] = []
    with report_problems(problems):
        try:
            for path, name in track(list(zip(paths, names, strict=True)), "predicting"):
                try:
                    found.append(predict_one(predictor, path, name, writer))
                except UnreadableError as error:
                    problems.append(str(error))
        finally:  # whoever stops it keeps what was found
            if found:
                writer.finish(found)
        if found:
            print_table(("image", "polylines", "ms"), rows(found))
            typer.echo(summary(found, out))


__all__ = ["predict_images"]
