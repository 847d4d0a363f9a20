"""What every section of the benchmark starts from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from yolino.datasets.synthetic import Synthetic
from yolino.inference import Predictor, load
from yolino.inference.loading import model_path
from yolino.io import read_image, write_image

FRAME_SIZE = (720, 1280)


@dataclass(frozen=True)
class Setup:
    """How to measure, and the input that sections share.

    Attributes:
        folder: Where files may be written meanwhile.
        model: "default" or a model file.
        device: "auto", "cpu" or "cuda".
        engine: What runs the model, and
        precision: in which arithmetic (`yolino.inference.EngineChoice`).
        threads: Threads of the network, OpenCV and torch.
        streams: Callers of the network at once.
        repeats: Largest number of rounds of a race.
        seconds: Time after which a race starts no further round.
        quick: Whether to take tiny inputs, to see that everything runs; the numbers mean nothing then.
        image: The frame's file; a drawn road of 720x1280 if None.
    """

    folder: Path
    model: str = "default"
    device: str = "auto"
    engine: str = "auto"
    precision: str = "auto"
    threads: int = 1
    streams: int = 1
    repeats: int = 30
    seconds: float = 10.0
    quick: bool = False
    image: Path | None = None

    @property
    def pace(self) -> dict[str, Any]:
        """The arguments of a race."""
        return {"rounds": self.repeats, "seconds": self.seconds}

    @property
    def batch(self) -> int:
        """Images in a batch: what keeps the device busy."""
        return 2 if self.quick else 64 if self.device == "cuda" else 8

    @property
    def rng(self) -> np.random.Generator:
        """Random numbers that are the same in each section and each run."""
        return np.random.default_rng(0)

    @cached_property
    def predictor(self) -> Predictor:
        """The model, with its post-processing.

        Raises:
            ValueError: The model goes over images in windows: a frame has no single run of the network.
        """
        predictor = load(
            self.model, engine=self.engine, device=self.device, precision=self.precision, threads=self.threads
        )
        if predictor.header.fit == "window":
            raise ValueError(
                f"The model {predictor.header.name} goes over images in windows, and the clocks stand "
                "between the steps of whole frames: give a model for whole images, or time `yolino predict`."
            )
        predictor.warm_up()
        return predictor

    @cached_property
    def frame(self) -> UInt8[np.ndarray, "h w 3"]:
        """RGB pixels of the frame."""
        if self.image is not None:
            return read_image(self.image)
        drawn = Synthetic(kind="road", length=1, seed=3, size=FRAME_SIZE)[0].image
        assert isinstance(drawn, np.ndarray)
        return drawn

    @cached_property
    def jpeg(self) -> Path:
        """The frame as a JPEG file: the one that was given, if it is one."""
        if self.image is not None and self.image.suffix.lower() in (".jpg", ".jpeg"):
            return self.image
        path = self.folder / "frame.jpg"
        write_image(path, self.frame)
        return path

    def describe_model(self) -> dict[str, Any]:
        """Gives name, file and shape of the model, as JSON has them."""
        path, header = model_path(self.model), self.predictor.header
        files = [path, path.with_suffix(".bin")] if path.suffix == ".xml" else [path]
        return {
            "name": header.name,
            "file": path.name,
            "megabytes": round(sum(file.stat().st_size for file in files) / 1e6, 2),
            "size": list(header.size),
            "stride": header.stride,
            "predictors": header.predictors,
            "device": str(getattr(self.predictor.engine, "device", self.device)),
        }


__all__ = ["FRAME_SIZE", "Setup"]
