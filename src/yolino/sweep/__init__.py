"""Several experiments, one table: runs a folder of experiment files and compares what came of them."""

from __future__ import annotations

from yolino.sweep.description import Sweep, load_sweep
from yolino.sweep.facts import facts
from yolino.sweep.jobs import Job, plan
from yolino.sweep.plot import draw_curves
from yolino.sweep.run import Outcome, Prospect, prospects, run_sweep
from yolino.sweep.table import cells, heading, legend, notes, read_rows
from yolino.sweep.writing import write_tables

__all__ = [
    "Job",
    "Outcome",
    "Prospect",
    "Sweep",
    "cells",
    "draw_curves",
    "facts",
    "heading",
    "legend",
    "load_sweep",
    "notes",
    "plan",
    "prospects",
    "read_rows",
    "run_sweep",
    "write_tables",
]
