"""What the benchmark ran on."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from yolino.inference.engine import usable_cores

_PACKAGES = (
    "yolino",
    "numpy",
    "scipy",
    "numba",
    "onnxruntime",
    "onnxruntime-gpu",
    "openvino",
    "nncf",
    "opencv-python-headless",
    "opencv-python",
    "torch",
    "torchvision",
    "scikit-learn",
    "pillow",
)


def describe_machine(threads: int, device: str = "cpu") -> dict[str, Any]:
    """Gives processor, cores, threads, GPU, system, load and versions, as JSON has them.

    Args:
        threads: Threads that the network, OpenCV and torch may use.
        device: Where the network runs; the GPU is named for "cuda".
    """
    return {
        "cpu": _cpu_name(),
        "cores": usable_cores(),
        "threads": threads,
        "gpu": _gpu_name() if device == "cuda" else None,
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "versions": _versions(),
    }


def _cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    if sys.platform == "linux" and info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _gpu_name() -> str | None:
    """Gives the name of the GPU as its driver tells it; None where there is no such driver."""
    query = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
    if shutil.which(query[0]) is None:
        return None
    return subprocess.run(query, capture_output=True, text=True, check=False).stdout.strip() or None


def _versions() -> dict[str, str]:
    installed = {
        d.metadata["Name"].lower(): d.version for d in metadata.distributions() if d.metadata["Name"]
    }
    return {name: installed[name] for name in _PACKAGES if name in installed}


__all__ = ["describe_machine"]
