"""Segments to polylines: non-maximum suppression and linking, with all thresholds in cell units."""

from __future__ import annotations

from yolino.postprocess.chain import ChainLinker
from yolino.postprocess.graph import GraphLinker
from yolino.postprocess.nms import NMS
from yolino.postprocess.tree import TreeLinker

LINKERS: dict[str, type] = {"tree": TreeLinker, "chain": ChainLinker, "graph": GraphLinker}

__all__ = ["LINKERS", "NMS", "ChainLinker", "GraphLinker", "TreeLinker"]
