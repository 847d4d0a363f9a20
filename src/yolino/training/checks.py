"""What can be said before the first step: whether the model file that a run will write can be used."""

from __future__ import annotations

import inspect
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from yolino.config import Experiment, check_keys, suggest
from yolino.header import Header
from yolino.inference.postprocessing import build_flip, build_linker, build_nms, build_quarters
from yolino.postprocess import LINKERS, NMS
from yolino.training.callbacks import build_header
from yolino.training.confidence import build_confidence


def check_experiment(experiment: Experiment) -> Header:
    """Builds the header that the model file will carry, and from it what a user of the model will run.

    Returns:
        That header, with a made-up threshold where validation is to choose it.

    Raises:
        ValueError: The linker or `loss.confidence` is unknown, a key of the linker or the NMS is unknown or
            out of range, what is said of windows or of mirrored images does not fit them, or there is no
            compiler for `training.compile`.
    """
    post = experiment.postprocess
    if post.linker not in LINKERS:
        raise ValueError(
            f"postprocess.linker {post.linker!r} is unknown; {suggest(post.linker, LINKERS)}"
            f"Known are {', '.join(LINKERS)}."
        )
    if experiment.training.compile and not has_compiler():
        raise ValueError(
            "training.compile needs a C++ compiler, and none is found: install g++ or clang++, name one in "
            "the environment variable CXX, or leave training.compile=false."
        )
    build_confidence(experiment.loss.confidence)
    check_keys("postprocess.nms", post.nms, _options(NMS))
    check_keys("postprocess.linker_options", post.linker_options, _options(LINKERS[post.linker]))
    for key in ("name", "pretrained"):
        if key in experiment.model.backbone_args:
            instead = {"name": "model.backbone", "pretrained": "model.pretrained"}[key]
            raise ValueError(f"model.backbone_args must not hold {key!r}: give {instead} instead.")
    with _naming("the header of the model file"):
        header = build_header(experiment, {"threshold": 0.5})
    builders: dict[str, Callable[[Header], object]] = {
        "postprocess.nms": build_nms,
        "postprocess.linker_options": build_linker,
        "postprocess.rotations": build_quarters,
        "postprocess.flip": build_flip,
    }
    for key, build in builders.items():
        with _naming(key):
            build(header)
    return header


def has_compiler() -> bool:
    """Tells whether `torch.compile` finds a compiler for what it writes."""
    return any(map(shutil.which, filter(None, (os.environ.get("CXX"), "g++", "clang++", "cl"))))


def _options(kind: type) -> list[str]:
    """Gives what may be set of the NMS or a linker: all arguments but the side of a cell."""
    return [name for name in inspect.signature(kind).parameters if name != "cell_size"]


@contextmanager
def _naming(key: str) -> Iterator[None]:
    """Puts the key of the experiment file before what is wrong with it."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from error
