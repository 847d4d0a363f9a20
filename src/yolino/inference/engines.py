"""What runs a network: the engines by name, and which one takes a file where none is named."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from yolino.header import Header
from yolino.inference.engine import (
    DEVICES,
    METADATA_KEY,
    PRECISIONS,
    Engine,
    check_arguments,
    check_file,
)
from yolino.inference.engine_onnxruntime import ONNX_PRECISIONS, OnnxEngine
from yolino.inference.engine_openvino import OPENVINO_PRECISIONS, OpenVinoEngine
from yolino.inference.onnx_metadata import read_onnx_metadata

_TORCH = {"cpu": ("fp32", "bf16", "fp16"), "cuda": ("fp32", "bf16", "fp16")}


@dataclass(frozen=True)
class EngineKind:
    """What is known of an engine before it is imported.

    Attributes:
        suffixes: Files that it reads.
        precisions: Arithmetic on each of its devices.
        packages: What has to be installed.
        install: How.
        opener: Its class or function as `module:name`.
        automatic: Whether it is chosen where none is named.
        cuda: Beginning of the name of a file, `package/pattern`, that only comes with CUDA; "" where CUDA
            makes no difference to the choice.
    """

    suffixes: tuple[str, ...]
    precisions: Mapping[str, tuple[str, ...]]
    packages: tuple[str, ...]
    install: str
    opener: str
    automatic: bool = True
    cuda: str = ""

    @property
    def missing(self) -> str | None:
        """The first package that is not installed."""
        return next((name for name in self.packages if importlib.util.find_spec(name) is None), None)

    def devices(self, device: str) -> tuple[str, ...]:
        """Gives what "auto" may mean here, as far as it is seen without an import; else the device itself."""
        if device != "auto":
            return (device,)
        return tuple(name for name in self.precisions if name != "cuda" or _is_there(self.cuda))

    def can(self, device: str, precision: str) -> bool:
        """Tells whether it has such arithmetic on such a device; "auto" is any."""
        offered = [found for name, found in self.precisions.items() if device in ("auto", name)]
        return any(precision == "auto" or precision in found for found in offered)


def _is_there(start: str) -> bool:
    """Tells whether a package has a file whose name begins so; "" is always there."""
    if not start:
        return True
    package, _, place = start.partition("/")
    spec = importlib.util.find_spec(package)
    folders = (spec and spec.submodule_search_locations) or ()
    return any(any(Path(folder).glob(f"{place}*")) for folder in folders)


# Where none is named, the first that is installed and can do what is asked takes a file (`choose_engine`).
ENGINES: dict[str, EngineKind] = {
    "onnxruntime": EngineKind(
        (".onnx",),
        ONNX_PRECISIONS,
        ("onnxruntime",),
        "pip install onnxruntime",
        "yolino.inference.engine_onnxruntime:OnnxEngine",
        cuda="onnxruntime/capi/*onnxruntime_providers_cuda",
    ),
    "openvino": EngineKind(
        (".xml", ".onnx"),
        OPENVINO_PRECISIONS,
        ("openvino",),
        "pip install 'yolino[openvino]'",
        "yolino.inference.engine_openvino:OpenVinoEngine",
    ),
    "torch": EngineKind(
        (".safetensors",),
        _TORCH,
        ("torch", "safetensors"),
        "pip install 'yolino[train]'",
        "yolino.model.engine:TorchEngine",
    ),
    "torch-compiled": EngineKind(
        (".safetensors",),
        _TORCH,
        ("torch", "safetensors"),
        "pip install 'yolino[train]'",
        "yolino.model.engine:compiled_engine",
        automatic=False,
    ),
}
_QUICKEST = {"int8": "openvino"}  # comes first for files of this precision: 2.5 times as fast
SUFFIXES = tuple(dict.fromkeys(suffix for kind in ENGINES.values() for suffix in kind.suffixes))


def open_engine(
    path: Path | str,
    *,
    engine: str = "auto",
    device: str = "auto",
    precision: str = "auto",
    threads: int | None = None,
    streams: int = 1,
) -> Engine:
    """Gives the engine that runs the model file `path`.

    Args:
        path: A model file; its suffix says which engines read it.
        engine: A name in `ENGINES`; "auto" takes the first that reads the file, is installed, and has what is
            asked for.
        device: "auto", "cpu" or "cuda".
        precision: Arithmetic of the network: "auto" (fp32; int8 where the file is quantized), "fp32", "bf16",
            "fp16" or "int8".
        threads: Threads of the network on a processor; None lets the engine decide.
        streams: Calls at once that the threads are shared among.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the suffix is unknown, the file is no YOLinO model, or the engine is unknown, does not
            read it, or has no such device or precision.
        ModuleNotFoundError: If the engine needs a package that is not installed.
    """
    path = Path(path)
    check_arguments(device, threads, streams)
    if precision not in PRECISIONS:
        raise ValueError(f"The precision {precision!r} is unknown; use one of {', '.join(PRECISIONS)}.")
    check_name(engine)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"The model {path} has the suffix {path.suffix!r}; known model files end in "
            f"{', '.join(SUFFIXES)}."
        )
    check_file(path)
    name = engine if engine != "auto" else choose_engine(path, device, precision)
    kind = ENGINES[name]
    _check_fit(name, kind, path, device, precision)
    if kind.missing is not None:
        raise ModuleNotFoundError(_describe_missing(name, kind, path))
    module, _, attribute = kind.opener.partition(":")
    opener = getattr(importlib.import_module(module), attribute)
    opened: Engine = opener(path, device=device, precision=precision, threads=threads, streams=streams)
    return opened


def choose_engine(path: Path, device: str = "auto", precision: str = "auto") -> str:
    """Gives the name of the engine for a file where none is named (`docs/adr/0011-engines.md`).

    It is the first in `ENGINES` that reads the file, has what is asked for, and is installed. For a quantized
    file OpenVINO comes first, unless the device is "auto" and ONNX Runtime has CUDA.

    Raises:
        ValueError: If none that reads the file has such arithmetic on such a device.
    """
    readers = [
        name for name, kind in ENGINES.items() if kind.automatic and path.suffix.lower() in kind.suffixes
    ]
    here = {name: ENGINES[name].devices(device) for name in readers}
    able = [name for name in readers if any(ENGINES[name].can(one, precision) for one in here[name])]
    if not able:
        offered = sorted(
            {d for name in readers for d, p in ENGINES[name].precisions.items() if precision in p}
        )
        instead = f"the device {' or '.join(offered)}" if offered else "another --precision"
        raise ValueError(
            f"No engine runs {path.suffix} files in {precision} on {device}: take {instead}, or another file."
        )
    if path.suffix.lower() == ".onnx" and len(able) > 1 and not any("cuda" in here[name] for name in able):
        first = _QUICKEST.get(_stored_precision(path))
        able.sort(key=lambda name: name != first)
    return next((name for name in able if ENGINES[name].missing is None), able[0])


def _stored_precision(path: Path) -> str:
    """Gives the precision of the weights of an ONNX file; what is wrong with its header its engine tells."""
    try:
        return Header.from_json(read_onnx_metadata(path).get(METADATA_KEY, "")).precision
    except ValueError:
        return "fp32"


def check_name(engine: str) -> None:
    """Raises ValueError, with the nearest right name, if there is no such engine."""
    if engine != "auto" and engine not in ENGINES:
        from yolino.config import suggest

        raise ValueError(
            f"The engine {engine!r} is unknown; {suggest(engine, ENGINES)}use auto or one of "
            f"{', '.join(ENGINES)}."
        )


def _check_fit(name: str, kind: EngineKind, path: Path, device: str, precision: str) -> None:
    if path.suffix.lower() not in kind.suffixes:
        others = [other for other, one in ENGINES.items() if path.suffix.lower() in one.suffixes]
        raise ValueError(
            f"The engine {name} reads {' and '.join(kind.suffixes)} files, but the model is {path}: "
            f"take the engine {' or '.join(others)}."
        )
    if not kind.can(device, "auto"):
        raise ValueError(f"The engine {name} has no device {device!r}; it has {', '.join(kind.precisions)}.")
    if not kind.can(device, precision):
        offered = [f"{', '.join(found)} on {where}" for where, found in kind.precisions.items()]
        raise ValueError(f"The engine {name} has no precision {precision!r}; it has {' and '.join(offered)}.")


def _describe_missing(name: str, kind: EngineKind, path: Path) -> str:
    exported = ", or use its exported .onnx file" if path.suffix.lower() == ".safetensors" else ""
    return (
        f"The engine {name} needs the package {kind.missing}, which is not installed: "
        f"{kind.install}{exported}."
    )


__all__ = [
    "DEVICES",
    "ENGINES",
    "METADATA_KEY",
    "PRECISIONS",
    "SUFFIXES",
    "Engine",
    "EngineKind",
    "OnnxEngine",
    "OpenVinoEngine",
    "choose_engine",
    "open_engine",
]
