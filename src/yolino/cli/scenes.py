"""What `yolino predict` does with a whole scene: one source, one file of all its polylines."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import typer

if TYPE_CHECKING:
    from yolino.datasets.georeference import Georeference
    from yolino.header import Header
    from yolino.inference import Predictor
    from yolino.inference.scene import Scan
    from yolino.inference.scene_store import SceneStore
    from yolino.inference.views import Raster
    from yolino.types import Polylines

SCENE_SUFFIXES = (".gpkg", ".geojson", ".parquet", ".json")
_OTHER = (
    ".shp",
    ".fgb",
    ".kml",
    ".kmz",
    ".gml",
    ".gpx",
    ".dxf",
    ".csv",
    ".tab",
    ".sqlite",
    ".topojson",
    ".zip",
)
_NEEDED = {".gpkg": ("pyogrio",), ".parquet": ("pyarrow",)}
_INTERRUPTED = 130


class Scene(NamedTuple):
    """Options that only scenes have; None is the default.

    Attributes:
        overlap: What neighboring windows share, in pixels of the network.
        bands: Numbers of the bands to see, with commas.
        scale: Pixels of the network per pixel of the scene.
    """

    overlap: int | None = None
    bands: str | None = None
    scale: float | None = None


def is_scene(out: Path, options: Scene = Scene(), format: str = "json") -> bool:
    """Tells whether the results are to be one file of map features (or JSON), by the suffix of its name.

    Raises:
        ValueError: Such a file cannot be written, or options are given that do not go together.
    """
    suffix = out.suffix.lower()
    known = ", ".join(SCENE_SUFFIXES)
    if suffix in _OTHER and not out.is_dir():
        raise ValueError(f"--out {out} ends in {suffix}, which is not written: use {known}, or a folder.")
    scene = suffix in SCENE_SUFFIXES and not out.is_dir()
    if scene and format != "json":
        raise ValueError(f"--format {format} is for a folder; what --out {out} holds is told by its suffix.")
    given = [f"--{name}" for name, value in options._asdict().items() if value is not None]
    if given and not scene:
        raise ValueError(f"{given[0]} is for a scene: give --out a name that ends in one of {known}.")
    return scene


def predict_scene(
    sources: Sequence[str], out: Path, options: Scene, *, model: str, threshold: float | None, device: str
) -> None:
    """Finds the polylines of a scene; writes one file.

    Raises:
        ValueError: An argument is not allowed, or the scene or the model cannot be read.
        FileNotFoundError: The scene or the model does not exist.
    """
    from yolino.cli.screen import busy, report_problems
    from yolino.inference.predictor import model_path
    from yolino.inference.scene import link, scan
    from yolino.inference.scene_raster import open_scene
    from yolino.inference.scene_store import SceneStore

    path = _check_paths(sources, out)
    bands = _parse_bands(options.bands)
    for package in _NEEDED.get(out.suffix.lower(), ()):  # now, not after hours
        importlib.import_module(package)
    with busy("loading the model (once after an installation, kernels are compiled: up to a minute)"):
        predictor = _load(model, path, options, threshold=threshold, device=device)
        predictor.warm_up()
    raster = open_scene(path, bands)
    settings = _settings(predictor, raster, path, model_path(model), bands)
    store = SceneStore(out.with_name(out.name + ".partial"), settings)
    _tell_start(store)
    problems: list[str] = []
    with report_problems(problems):
        with _going_on(store, len(predictor.plan(raster.size))) as advance:
            done = scan(predictor, raster, store, advance=advance)
        with busy("merging and linking the segments"):
            polylines = link(predictor, raster, store)
        _write(out, path, raster, polylines, predictor.header)
        if done.failures:
            problems.append(_describe_failures(done, path, store.folder))
        else:
            store.remove()
        _tell_end(done, polylines, out)


def _check_paths(sources: Sequence[str], out: Path) -> Path:
    if len(sources) != 1:
        raise ValueError(
            f"--out {out} is one file, for one scene, but {len(sources)} sources are given: give one, or a "
            "folder as --out."
        )
    path = Path(sources[0])
    if path.is_dir():
        raise ValueError(f"{path} is a folder, but --out {out} is one file, for one scene: give an image.")
    if not path.is_file():
        raise FileNotFoundError(f"There is no scene {path}.")
    if out.exists():
        raise ValueError(f"--out {out} exists already and is not replaced: remove it or give another name.")
    return path


def _parse_bands(text: str | None) -> tuple[int, ...] | None:
    if text is None:
        return None
    try:
        return tuple(int(number) for number in text.split(","))
    except ValueError:
        raise ValueError(f"--bands is {text!r}, but must be three numbers (or one), like 3,2,1.") from None


def _load(model: str, path: Path, options: Scene, *, threshold: float | None, device: str) -> Predictor:
    """Gives the predictor, whose fit is "window"."""
    from yolino.inference import Predictor, open_engine
    from yolino.inference.predictor import model_path

    engine = open_engine(model_path(model), device=device)
    header: Header = engine.header
    scale, windows = options.scale, f"windows of {header.size[0]} x {header.size[1]}"
    if header.fit != "window" and scale is None:
        raise ValueError(
            f"The model {header.name} sees whole images (fit {header.fit!r}), no windows of a scene: give "
            f"--scale 1 to go over {path} in {windows} pixels, a model for scenes, or a folder as --out."
        )
    if scale is not None:
        if not 0 < scale <= 16:
            raise ValueError(f"--scale is {scale}, but must be above 0 and at most 16.")
        if header.fit != "window":
            _say(f"The model {header.name} was trained on whole images; it goes over {path} in {windows}.")
        header = replace(header, fit="window", scale=float(scale))
    return Predictor(engine, header, threshold=threshold, overlap=options.overlap)


def _settings(
    predictor: Predictor, raster: Raster, path: Path, model: Path, bands: Sequence[int] | None
) -> dict[str, object]:
    """Gives all that the segments of the windows depend on."""
    plan, state = predictor.plan(raster.size), path.stat()
    with open(model, "rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return {
        "model": digest,
        "scene": str(path.resolve()),
        "scene bytes": state.st_size,
        "scene time": state.st_mtime_ns,
        "bands": None if bands is None else list(bands),
        "scale": predictor.header.scale,
        "window": list(plan.window),
        "overlap": plan.overlap,
        "size": list(raster.size),
        "threshold": predictor.threshold,
    }


@contextlib.contextmanager
def _going_on(store: SceneStore, total: int) -> Iterator[Callable[[int], None]]:
    """Shows the progress; whoever stops it is told how to go on."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("windows"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[speed]}"),
        TimeRemainingColumn(),
    )
    done = len(store.done)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("windows", total=total - done, speed="")

        def advance(count: int) -> None:
            progress.advance(task, count)
            speed = progress.tasks[0].speed
            progress.update(task, speed=f"{speed:.1f}/s" if speed else "")

        try:
            yield advance
        except KeyboardInterrupt:
            progress.stop()
            _say(
                f"Stopped after {len(store.done)} of {total} windows, kept in {store.folder}: the same "
                "command goes on from there."
            )
            raise typer.Exit(_INTERRUPTED) from None


def _tell_start(store: SceneStore) -> None:
    if store.changed:
        names = ", ".join(store.changed)
        _say(f"Earlier work in {store.folder} was done with another {names}: beginning anew.")
    elif store.chunks:
        _say(f"Going on with {store.folder}: {len(store.done)} windows are done.")


def _write(out: Path, path: Path, raster: Raster, polylines: Polylines, header: Header) -> None:
    """Writes the file of the scene and tells what its coordinates mean, where that is not plain."""
    from yolino.datasets.feature_files import FEATURE_WRITERS
    from yolino.datasets.features import to_features
    from yolino.io import Result, to_json, write_atomic

    if out.suffix.lower() == ".json":
        write_atomic(
            out, to_json(Result(path.as_posix(), raster.size, polylines, header.classes, header.name))
        )
        return
    place = _place(path, raster)
    if place is None:
        _say(f"{path} has no place on the map: coordinates and lengths are in pixels.")
    elif place.crs is None:
        _say(f"{path} names no coordinate reference system: coordinates are in its units, lengths in pixels.")
    about = {"image": path.as_posix(), "model": header.name, "licence": header.licence}
    FEATURE_WRITERS[out.suffix.lower()](out, to_features(polylines, header.classes, place, about))


def _place(path: Path, raster: Raster) -> Georeference | None:
    from yolino.datasets.georeference import read_georeference
    from yolino.inference.views import ImageRaster

    return None if isinstance(raster, ImageRaster) else read_georeference(path)


def _describe_failures(done: Scan, path: Path, folder: Path) -> str:
    (left, top, right, bottom), reason = done.failures[0]
    count = len(done.failures)
    return (
        f"{count} of the {done.windows} windows of {path} cannot be read and {'is' if count == 1 else 'are'} "
        f"missing in the result, the first at x {left} to {right}, y {top} to {bottom} ({reason}). "
        f"{folder} is kept: without the result, the same command tries only these again."
    )


def _say(sentence: str) -> None:
    typer.echo(sentence, err=True)


def _tell_end(done: Scan, polylines: Polylines, out: Path) -> None:
    empty = f" ({done.empty} without data)" if done.empty else ""
    count = f"{len(polylines)} polyline{'s' * (len(polylines) != 1)}"
    typer.echo(f"{done.windows} window{'s' * (done.windows != 1)}{empty}, {count} -> {out}")


__all__ = ["SCENE_SUFFIXES", "Scene", "is_scene", "predict_scene"]
