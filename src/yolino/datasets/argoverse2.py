"""Argoverse 2 (sensor dataset): the center lines of the map's lanes, projected into the images of a camera.

The files of a log, as they are published:

    <log>/map/log_map_archive_<log>____<city>.json     lane segments: their boundaries, in city coordinates
    <log>/city_SE3_egovehicle.feather                  pose of the vehicle, by time
    <log>/calibration/egovehicle_SE3_sensor.feather    pose of each camera on the vehicle
    <log>/calibration/intrinsics.feather               focal lengths, principal points, sizes
    <log>/sensors/cameras/<camera>/<time in ns>.jpg    the images

The images are free of distortion, so the distortion coefficients are not used. The principal point is taken
to count pixels, as the official projection does (its image ends at width - 1): half a pixel is added.

The map has boundaries, not center lines: a center line is the mean of both boundaries, each walked at
constant speed. Where one lane segment leads to the next, they share a vertex. What hides the lanes is not
known (`max_distance` is all there is); boundaries, crossings and areas are left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.argoverse2_log import BY, Log, read_log
from yolino.datasets.files import FileDataset, Names
from yolino.io import image_size

# Nearer than this, in meters, lies no road: the cameras are 1.4 m above it.
_NEAR = 0.1


@dataclass(frozen=True, eq=False)
class _Frame(Annotation):
    """An annotation whose lines are still in the map of its log."""

    file: Path = Path()
    log: Log | None = None


class Argoverse2(FileDataset):
    """Images of one camera with the center lines of the lanes before it, in driving direction.

    Maps, poses and calibrations are read when the dataset is made; the lanes are projected when a sample is
    asked for.

    Args:
        root: A log, a folder of logs (`val`), or a folder of such folders.
        labels: Logs, folders of logs or map files, absolute or below `root`; None: all below `root`.
        camera: Name of the camera: `ring_front_center`, `ring_front_left`, `stereo_front_left`, ...
        every: Takes every so-manieth image of a log; they are 50 ms apart.
        max_distance: Distance from the camera in meters beyond which lanes are left out; None: without end
            (the maps end 100 m from the vehicle's way).
        by: What the classes are: `none` (all lanes are of the class `centerline`), `lane_type` (`VEHICLE`,
            `BIKE`, `BUS`) or `intersection` (`intersection`, `lane`).
        options: The other arguments of `FileDataset`.

    Raises:
        LabelError: A file of a log is missing or broken, or the images are not those of the calibration.
    """

    patterns = tuple(f"{depth}map/log_map_archive_*.json" for depth in ("", "*/", "*/*/"))
    default_class = "centerline"

    def __init__(
        self,
        root: str | Path,
        labels: Names | None = None,
        *,
        camera: str = "ring_front_center",
        every: int = 1,
        max_distance: float | int | None = 50.0,
        by: str = "none",
        **options: Any,
    ) -> None:
        if by not in BY:
            raise ValueError(f"The classes are by {by!r}, but must be by {', '.join(BY)}.")
        if every < 1:
            raise ValueError(f"every is {every}, but must be at least 1: every image.")
        if max_distance is not None and not max_distance > 0:
            raise ValueError(f"max_distance is {max_distance}, but must be a positive number of meters.")
        self.camera, self.every, self.by = camera, every, by
        self.max_distance = None if max_distance is None else float(max_distance)
        self._counts: Counter[str] = Counter()
        super().__init__(root, labels, **options)
        left = {name: n for name, n in self._counts.items() if name not in self._label_of}
        self.left_out = Counter(left)

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields the frames of the log that a map belongs to, still without lines."""
        log = read_log(path, self.camera, self.by)
        images = sorted((log.root / "sensors" / "cameras" / self.camera).glob("*.jpg"))
        if not images:
            raise LabelError(
                str(log.root), f"has no images sensors/cameras/{self.camera}/*.jpg, which are needed"
            )
        self._check_size(images[0], log)
        self._counts.update(log.names)
        for image in images[:: self.every]:
            where = f"{path}, image {image.name}"
            if not image.stem.isdecimal():
                yield LabelError(where, "is not named by its time in nanoseconds")
                continue
            try:
                log.pose_at(int(image.stem), where)
            except LabelError as error:
                yield error
                continue
            name = image.relative_to(self.root).as_posix() if image.is_relative_to(self.root) else str(image)
            yield _Frame(name, where, size=log.camera.size, file=image, log=log)

    def complete(self, annotation: Annotation) -> Annotation:
        """Gives the annotation with the lanes that its image shows."""
        assert isinstance(annotation, _Frame)
        log = annotation.log
        assert log is not None
        view = log.pose_at(int(annotation.file.stem), annotation.where) @ log.mount
        lines = log.camera.project_lines(
            view.to_inner(log.vertices), log.offsets, near=_NEAR, max_distance=self.max_distance
        )
        names = tuple(log.names[i] for i in lines.labels)
        return replace(annotation, lines=tuple(lines), names=names)

    def found_classes(self) -> tuple[str, ...]:
        """Gives the names of the classes that occur in the maps."""
        return tuple(sorted(self._counts))

    def _expand(self, given: str | Path) -> list[Path]:
        folder = self._below_root(given)
        if folder.is_dir():
            for pattern in self.patterns:
                if found := sorted(folder.glob(pattern)):
                    return found
        return super()._expand(given)

    def _image_path(self, one: Annotation) -> Path:
        assert isinstance(one, _Frame)
        return one.file

    def _choose_classes(
        self, wanted: Sequence[str] | Mapping[str, str] | None
    ) -> tuple[tuple[str, ...], dict[str, int]]:
        classes, label_of = super()._choose_classes(wanted)
        if self._counts and not set(label_of) & set(self._counts):
            raise ValueError(
                f"None of the classes {', '.join(label_of)} occurs in {self.root}; "
                f"by {self.by} its lanes have {', '.join(sorted(self._counts))}."
            )
        return classes, label_of

    def _check_size(self, image: Path, log: Log) -> None:
        """Raises if an image does not have the size that the calibration is for."""
        try:
            height, width = image_size(image)
        except ValueError as error:
            raise LabelError(str(log.root), f"has a broken image: {str(error).removesuffix('.')}") from None
        if (height, width) != log.camera.size:
            raise LabelError(
                f"{log.root}, image {image.name}",
                f"has {width} x {height} pixels, but the calibration is for {log.camera.size[1]} x "
                f"{log.camera.size[0]}; use the images as they were published",
            )


__all__ = ["Argoverse2"]
