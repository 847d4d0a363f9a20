"""Benchmark: every number that this project promises, side by side in one run (`docs/benchmark.md`)."""

from __future__ import annotations

from yolino.benchmark.plot import plot
from yolino.benchmark.report import report
from yolino.benchmark.run import SECTIONS, benchmark
from yolino.benchmark.saved import read_result
from yolino.benchmark.summary import summary

__all__ = ["SECTIONS", "benchmark", "plot", "read_result", "report", "summary"]
