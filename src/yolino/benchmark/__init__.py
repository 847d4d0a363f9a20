"""Benchmark: every number that this project promises, side by side in one run (`docs/benchmark.md`)."""

from __future__ import annotations

from yolino.benchmark.report import report
from yolino.benchmark.run import SECTIONS, benchmark

__all__ = ["SECTIONS", "benchmark", "report"]
