"""What `yolino predict` does with a whole scene: one source, one file of all its polylines."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import typer

from yolino.cli.outputs import SCENE_SUFFIXES, ending

if TYPE_CHECKING:
    from yolino.header import Header
    from yolino.inference import EngineChoice, Predictor
    from yolino.inference.scene import Scan
    from yolino.inference.scene_store import SceneStore
    from yolino.inference.views import Raster
    from yolino.types import Polylines

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

    @property
    def given(self) -> list[str]:
        """Names of the options that are given."""
        return [f"--{name}" for name, value in self._asdict().items() if value is not None]


def is_scene(
    out: str | Path,
    options: Scene = Scene(),
    format: str = "json",
    *,
    pictures: bool | None = None,
    view: str | None = None,
) -> bool:
    """Tells whether the results are to be one file of map features (or JSON), by the suffix of its name.

    Args:
        out: Name of the file, or of a folder.
        options: What only scenes have.
        format: "json": what a scene becomes is told by the suffix.
        pictures: None: a scene gives no pictures.
        view: None, likewise.

    Raises:
        ValueError: Options are given that do not go together.
    """
    if ending(out) not in SCENE_SUFFIXES:
        if given := options.given:
            known = ", ".join(SCENE_SUFFIXES)
            raise ValueError(f"{given[0]} is for a scene: give --out a name that ends in one of {known}.")
        return False
    if format != "json":
        raise ValueError(f"--format {format} is for a folder; what --out {out} holds is told by its suffix.")
    shown = [f"--view {view}"] if view is not None else []
    shown += ["--images" if pictures else "--no-images"] if pictures is not None else []
    if shown:
        raise ValueError(
            f"{shown[0]} is for pictures, but --out {out} is one file of lines without any: leave it out."
        )
    return True


def refuse_for_videos(options: Scene, video: str) -> None:
    """Raises ValueError if options of scenes are given for a video."""
    if given := options.given:
        raise ValueError(f"{given[0]} is for scenes, but {video} is a video (by its name): leave it out.")


def predict_scene(
    sources: Sequence[str],
    out: Path,
    options: Scene,
    *,
    model: str,
    threshold: float | None,
    choice: EngineChoice,
) -> None:
    """Finds the polylines of a scene; writes one file.

    Raises:
        ValueError: An argument is not allowed, or the scene or the model cannot be read.
        FileNotFoundError: The scene or the model does not exist.
    """
    from yolino.cli.scene_file import find_place, write_scene
    from yolino.cli.screen import busy, report_problems
    from yolino.inference.loading import model_path
    from yolino.inference.scene import link, scan
    from yolino.inference.scene_raster import open_scene
    from yolino.inference.scene_store import SceneStore
    from yolino.io import Result

    path = _check_paths(sources, out)
    bands = _parse_bands(options.bands)
    for package in _NEEDED.get(out.suffix.lower(), ()):  # now, not after hours
        importlib.import_module(package)
    raster = open_scene(path, bands)
    place = find_place(out, path, raster)
    with busy("loading the model (once after an installation, kernels are compiled: up to a minute)"):
        predictor = _load(model, path, raster.size, options, threshold=threshold, choice=choice)
        predictor.warm_up()
    settings = _settings(predictor, raster, path, model_path(model), bands)
    store = SceneStore(out.with_name(out.name + ".partial"), settings)
    _tell_start(store)
    problems: list[str] = []
    with report_problems(problems):
        with _going_on(store, len(predictor.plan(raster.size))) as advance:
            done = scan(predictor, raster, store, advance=advance)
        with busy("merging and linking the segments"):
            polylines = link(predictor, raster, store)
        header = predictor.header
        result = Result(path.as_posix(), raster.size, polylines, header.classes, header.name)
        write_scene(out, result, place, header.licence)
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


def _load(
    model: str,
    path: Path,
    size: tuple[int, int],
    options: Scene,
    *,
    threshold: float | None,
    choice: EngineChoice,
) -> Predictor:
    """Gives the predictor, whose fit is "window", for a scene of `size` (height, width)."""
    from yolino.inference import Predictor

    engine = choice.open(model)
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
        _check_cells(scale, path, size, header)
        if header.fit != "window":
            _say(f"The model {header.name} was trained on whole images; it goes over {path} in {windows}.")
        postprocess = {key: value for key, value in header.postprocess.items() if key != "flip"}
        header = replace(header, fit="window", scale=float(scale), postprocess=postprocess)
    return Predictor(engine, header, threshold=threshold, overlap=options.overlap)


def _check_cells(scale: float, path: Path, size: tuple[int, int], header: Header) -> None:
    """Refuses a scale that leaves less than a cell of a scene; one that is thin itself needs not shrink."""
    lowest = min(1.0, header.scale, header.stride / min(size))
    if scale < lowest:
        height, width = (f"{side * scale:.3g}" for side in size)
        raise ValueError(
            f"--scale {scale:g} shows {path} ({size[0]} x {size[1]} pixels) to the network as {height} x "
            f"{width} pixels, less than one of its cells of {header.stride}: give "
            f"{math.ceil(lowest * 1e4) / 1e4:g} or more."
        )


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
        "engine": f"{predictor.engine.name} on {predictor.engine.device}",
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
    if store.chunks:
        _say(f"Going on with {store.folder}: {len(store.done)} windows are done.")


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


__all__ = ["Scene", "is_scene", "predict_scene", "refuse_for_videos"]
