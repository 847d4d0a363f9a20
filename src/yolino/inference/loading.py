"""A name or a file of a model -> a predictor."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path

from yolino.inference.engines import SUFFIXES, Engine, open_engine
from yolino.inference.postprocessing import Linker
from yolino.inference.predictor import Predictor


@dataclass(frozen=True)
class EngineChoice:
    """What is to run a network, and how.

    Attributes:
        engine: A name in `yolino.inference.engines.ENGINES`, or "auto".
        device: "auto", "cpu" or "cuda".
        precision: Arithmetic of the network: "auto", "fp32", "bf16", "fp16" or "int8".
        threads: Threads of the network on a processor; None lets the engine decide.
        streams: Calls at once that the threads are shared among.
    """

    engine: str = "auto"
    device: str = "auto"
    precision: str = "auto"
    threads: int | None = None
    streams: int = 1

    def open(self, model: Path | str) -> Engine:
        """Gives the engine for a model; raises what `open_engine` and `model_path` raise."""
        return open_engine(model_path(model), **asdict(self))


def model_path(model: Path | str) -> Path:
    """Gives the file of a model: that of a packaged one ("default"), or the path given.

    Raises:
        ValueError: If `model` is neither the name of a packaged model nor looks like a model file.
    """
    path = Path(model)
    folder = Path(str(resources.files("yolino"))) / "models"
    names = sorted(file.stem for file in folder.glob("*.onnx"))
    if str(model) in names:
        return folder / f"{model}.onnx"
    if path.suffix.lower() in SUFFIXES or path.is_file():
        return path
    allowed = "".join(f"{name!r} or " for name in names)
    suffixes = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
    raise ValueError(f"The model {str(model)!r} is unknown: give {allowed}the path of a file in {suffixes}.")


def load(
    model: Path | str = "default",
    *,
    engine: str = "auto",
    device: str = "auto",
    precision: str = "auto",
    threads: int | None = None,
    streams: int = 1,
    threshold: float | None = None,
    flip: bool | None = None,
    linker: Linker | None = None,
) -> Predictor:
    """Gives a predictor: `yolino.load()(image)` is a `Polylines`.

    Args:
        model: "default", or the path of an exported model (.onnx, or .xml for OpenVINO) or of a checkpoint
            (.safetensors, needs torch).
        engine: What runs the network: a name in `yolino.inference.engines.ENGINES`; "auto" takes the first
            that reads the file and is installed.
        device: "auto", "cpu" or "cuda".
        precision: Arithmetic of the network: "auto" (fp32; int8 where the file is quantized), "fp32", "bf16",
            "fp16" or "int8".
        threads: Threads of the network on a processor; None lets the engine decide.
        streams: Threads that will call the predictor at once; they share the threads of the network.
        threshold: Lowest score of a segment; the model's own by default.
        flip: Whether the network also sees the mirrored image: often better lines, in twice the time; the
            model's own by default.
        linker: Joins segments to polylines, in place of the model's own.

    Raises:
        FileNotFoundError: If the model file does not exist.
        ValueError: If the model is unknown or no YOLinO model, or the engine is unknown, does not read it, or
            has no such device or precision.
        ModuleNotFoundError: If the engine is not installed.
    """
    choice = EngineChoice(engine, device, precision, threads, streams)
    return Predictor(choice.open(model), threshold=threshold, flip=flip, linker=linker)


__all__ = ["EngineChoice", "load", "model_path"]
