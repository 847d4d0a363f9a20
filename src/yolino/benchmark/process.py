"""Sections `startup` and `install`: what a process takes until its first result, what all files weigh."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import numpy as np
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import yolino
from yolino.benchmark.clock import Times
from yolino.benchmark.measure import Measure, Section, Target, at_most
from yolino.benchmark.setup import Setup
from yolino.compiled import VARIABLE

_RUNS = 5
_MEGA = 1e6
STARTUP = (
    f"Each number comes from fresh Python processes (median of {_RUNS}); the files they read are in the "
    "system's cache. `yolino predict` goes over the frame, whose picture it writes, from start to end: as in "
    "the first run of all, with an empty folder in place of numba's cache; later, with that cache; and with "
    "compiled kernels, which many images have. Peak memory is what the system has counted for its process."
)
INSTALL = "The files of yolino and of all distributions that it requires without extras, as installed here."
# The peak of a process that was started by a large one: getrusage counts the parent's memory, /proc does not.
_PEAK = """
import json, sys
from yolino.cli import main
code = main(sys.argv[1:])
from pathlib import Path
status = Path("/proc/self/status")
if status.is_file():
    kilobytes = next(int(l.split()[1]) for l in status.read_text().splitlines() if l.startswith("VmHWM"))
else:
    import resource
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    kilobytes = peak / 1024 if sys.platform == "darwin" else peak
torch = "torch" in sys.modules
print(json.dumps({"code": code, "bytes": kilobytes * 1024, "torch": torch}))
"""
_IMPORT = "import time; t = time.perf_counter(); {}; print(time.perf_counter() - t)"
_DETECT = "import yolino; yolino.Predictor; import onnxruntime, yolino.postprocess"


def measure_startup(setup: Setup) -> Section:
    """Times imports and `yolino predict` in processes of their own, and gives the memory of the latter."""
    runs = 1 if setup.quick else _RUNS
    imports = [float(_python(_IMPORT.format("import yolino"))) for _ in range(runs)]
    rooms = [float(_python(_IMPORT.format(_DETECT))) for _ in range(runs)]
    with tempfile.TemporaryDirectory() as empty:
        first = [_predict(setup, NUMBA_CACHE_DIR=empty) for _ in range(runs)]
    later = [_predict(setup) for _ in range(runs)]
    peaks = [run.megabytes for run in later]
    measures = {
        "import": _values("import yolino", imports, "s", at_most(1.5)),
        "import_detect": _values("import yolino and all that detecting needs", rooms, "s", at_most(1.5)),
        "first": _values("yolino predict, first run of all", _seconds(first), "s", at_most(2.5)),
        "predict": _values("yolino predict, later", _seconds(later), "s", at_most(2.5)),
        "memory": _values("peak memory of yolino predict", peaks, "MB", at_most(600)),
    }
    if not setup.quick:  # which may have to compile them
        _predict(setup, YOLINO_KERNELS="compiled")
        compiled = [_predict(setup, YOLINO_KERNELS="compiled") for _ in range(runs)]
        title = "yolino predict with compiled kernels"
        measures["compiled"] = _values(title, _seconds(compiled), "s", None)
    return Section("Start and memory", STARTUP, measures)


class _Run(NamedTuple):
    """What a process of `yolino predict` took."""

    seconds: float
    megabytes: float


def _predict(setup: Setup, **variables: str) -> _Run:
    """Runs `yolino predict` on the frame in a process with these environment variables.

    Raises:
        RuntimeError: It fails.
    """
    arguments = ["predict", str(setup.jpeg), "--model", setup.model, "--device", setup.device]
    arguments += ["--out", str(setup.folder / "predicted")]
    start = time.perf_counter()
    result = json.loads(_python(_PEAK, *arguments, **variables).splitlines()[-1])
    seconds = time.perf_counter() - start
    if result["code"] != 0:
        raise RuntimeError(f"`yolino {' '.join(arguments)}` ended with exit code {result['code']}.")
    return _Run(seconds, result["bytes"] / _MEGA)


def _seconds(runs: list[_Run]) -> list[float]:
    return [run.seconds for run in runs]


def measure_install(setup: Setup) -> Section:
    """Adds up what an installation takes on the disk."""
    sizes = {name: _size_of(name) for name in core_distributions()}
    sizes["yolino"] = _folder_size(Path(yolino.__file__).parent)
    largest = sorted(sizes, key=sizes.__getitem__, reverse=True)[:5]
    note = ", ".join(f"{name} {sizes[name]:.0f}" for name in largest)
    total = Measure("installed size", sum(sizes.values()), "MB", target=at_most(300), note=note)
    return Section("Installation", INSTALL, {"size": total})


def core_distributions() -> set[str]:
    """Gives the names of yolino and of all that it requires here without extras, directly or not.

    Raises:
        RuntimeError: A required distribution is not installed.
    """
    found, left = set[str](), ["yolino"]
    while left:
        name = left.pop()
        if name in found:
            continue
        found.add(name)
        try:
            wanted = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            raise RuntimeError(f"{name} is required, but not installed: install yolino again.") from None
        left += _applying(wanted)
    return found


def _applying(requirements: Iterable[str]) -> list[str]:
    """Gives the names of the requirements that hold in this Python without extras."""
    parsed = [Requirement(text) for text in requirements]
    return [canonicalize_name(r.name) for r in parsed if r.marker is None or r.marker.evaluate({"extra": ""})]


def _size_of(name: str) -> float:
    """Gives the size of the files of a distribution in megabytes."""
    files = metadata.files(name) or []
    paths = (Path(str(file.locate())) for file in files)
    return sum(path.stat().st_size for path in paths if path.is_file()) / _MEGA


def _folder_size(folder: Path) -> float:
    paths = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return sum(path.stat().st_size for path in paths) / _MEGA


def _python(code: str, *arguments: str, **variables: str) -> str:
    """Gives what a fresh Python prints, where no tier of the kernels is forced but by `variables`.

    Raises:
        RuntimeError: It fails; the message has the last line of what it complains about.
    """
    command = [sys.executable, "-c", code, *arguments]
    environment = {key: value for key, value in os.environ.items() if key != VARIABLE} | variables
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
        raise RuntimeError(f"A Python process of the benchmark failed: {reason}")
    return done.stdout


def _values(title: str, values: list[float], unit: str, target: Target | None) -> Measure:
    low, high = Times(np.array(values)).quartiles
    return Measure(title, float(np.median(values)), unit, low, high, target)


__all__ = ["core_distributions", "measure_install", "measure_startup"]
