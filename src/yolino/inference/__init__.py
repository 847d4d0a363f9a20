"""From an image array to polylines, without torch: preprocess, engine, post-processing."""

from __future__ import annotations

from yolino.inference.engines import ENGINES, Engine, OnnxEngine, OpenVinoEngine, open_engine
from yolino.inference.loading import EngineChoice, load
from yolino.inference.predictor import Predictor, Stages
from yolino.inference.preprocess import Preprocess

__all__ = [
    "ENGINES",
    "Engine",
    "EngineChoice",
    "OnnxEngine",
    "OpenVinoEngine",
    "Predictor",
    "Preprocess",
    "Stages",
    "load",
    "open_engine",
]
