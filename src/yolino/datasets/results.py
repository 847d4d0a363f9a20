"""Results of yolino as labels: a JSON file per image, as `yolino predict` writes them.

```
{"image": "clips/a.jpg", "size": [720, 1280], "classes": ["solid", "dashed"], "model": "default",
 "version": "0.2.0", "polylines": [{"points": [[10.5, 700.0], [22.25, 650.0]], "score": 0.91, "label": 1}]}
```

The points are pixels of the image. A file names its image as `yolino predict` was given it: it is looked for
below the root, where the path leads from the working directory, and then by the end of the path. The form is
that of `yolino.io`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.files import FileDataset, Names
from yolino.datasets.image_paths import find_end
from yolino.datasets.writing import ImageWriter, without_suffix
from yolino.io import Result, from_json, to_json
from yolino.types import Sample


class ResultsWriter(ImageWriter):
    """Writes a file for each image, `clips/a.json` for `clips/a.jpg`.

    Args:
        out: The folder.
        classes: Names of the classes.
        directed: Not written.
        model: Name of the model that found the polylines.
    """

    loses = ("ignored regions", "scores beyond 1/10000", "vertices beyond 1/100 px")

    def __init__(
        self, out: Path, *, classes: Sequence[str] = (), directed: bool = True, model: str = ""
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        self._model = model

    def add(self, sample: Sample) -> None:
        """Writes the result of one image."""
        self.check(sample)
        if sample.size is None:
            raise ValueError(f"The size of {sample.name} is unknown, but results state it: give it.")
        result = Result(sample.name, sample.size, sample.polylines, self.classes, self._model)
        self.write(sample, f"{without_suffix(sample.name)}.json", to_json(result))


class Results(FileDataset):
    """Images and the polylines that a model found in them.

    Without `classes`, the classes are those of the model, in its order.

    Args:
        root: Folder of the results; of the images too, unless `images` says where they are or the results
            name them from the working directory.
        labels: Files, absolute or below `root`; None: all JSON files in `root` and below.
        options: The other arguments of `FileDataset`.
    """

    patterns = ("**/*.json",)
    writer = ResultsWriter

    def __init__(self, root: str | Path, labels: Names | None = None, **options: Any) -> None:
        self._listed: dict[str, None] = {}
        self._elsewhere: set[str] = set()
        super().__init__(root, labels, **options)

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields the annotation of a file."""
        where = str(path)
        try:
            result = from_json(path.read_text(encoding="utf-8"))
        except UnicodeDecodeError:
            raise
        except (ValueError, OverflowError, RecursionError) as error:
            reason = str(error).rstrip(".") or type(error).__name__
            raise LabelError(where, f"is not a result of yolino ({reason})") from None
        lines, (height, width) = result.polylines, result.size
        classes = result.classes or (self.default_class,)
        if not result.image:
            raise LabelError(where, "names no image")
        if min(height, width) < 1:
            raise LabelError(where, f"has the size {height} x {width}, but positive numbers are needed")
        if not (np.isfinite(lines.vertices).all() and np.isfinite(lines.scores).all()):
            raise LabelError(where, "has points or scores that are not finite, but numbers are needed")
        if len(lines) and not 0 <= lines.labels.min() <= lines.labels.max() < len(classes):
            raise LabelError(where, f"has labels that are no index of its {len(classes)} classes")
        self._listed.update(dict.fromkeys(classes))
        yield Annotation(
            self._image(result.image.replace("\\", "/"), path.parent),
            where,
            tuple(lines),
            tuple(classes[label] for label in lines.labels),
            lines.scores.tolist() if (lines.scores != 1).any() else (),
            size=(height, width),
        )

    def found_classes(self) -> tuple[str, ...]:
        """Gives the names of the model's classes."""
        return tuple(self._listed)

    def _image(self, name: str, beside: Path) -> str:
        """Gives the path of the image below one of the folders, or from the working directory."""
        below = self.root / name.lstrip("/")
        if self.images is None and not below.is_file() and Path(name).is_file():
            file, root = Path(name).resolve(), self.root.resolve()
            if file.is_relative_to(root):
                return file.relative_to(root).as_posix()
            # Before it is looked for by its end: the root may hold a picture of it with lines drawn.
            self._elsewhere.add(name)
            return name
        return find_end(self, name, beside) or name

    def _image_path(self, one: Annotation) -> Path:
        return Path(one.image) if one.image in self._elsewhere else super()._image_path(one)


__all__ = ["Results", "ResultsWriter"]
