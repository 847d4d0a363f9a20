"""All kernels that predicting needs, compiled ahead of the first image, in several processes at once."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np

from yolino.compiled import VARIABLE, are_kept, tier
from yolino.inference.loading import load
from yolino.types import Segments

_NAMED = "NUMBA_CACHE_DIR"


def _link(model: str) -> None:
    load(model, device="cpu", threads=1).linker(_line())


def _merge_and_smooth(model: str) -> None:
    from yolino.postprocess.spline import SmoothingSpline

    SmoothingSpline()(np.array([[0.0, 0.0], [1.0, 1.0]]))  # first: linking needs it, too, but not soon
    load(model, device="cpu", threads=1).nms(_line())


def _track(model: str) -> None:
    from yolino.inference.tracking import warm_up

    warm_up()


def _run_once(model: str) -> None:
    load(model, device="cpu", threads=1).warm_up()


JOBS: tuple[Callable[[str], None], ...] = (_link, _merge_and_smooth, _track)
"""What can be compiled at the same time; together, about all of it."""


def compile_ahead(model: Path | str = "default", *, processes: int = 2) -> Iterator[float]:
    """Compiles the kernels that images and videos need, and yields what share is done.

    What is on disk already is not compiled again.

    Args:
        model: Name or file of the model, which says how its segments are merged and linked.
        processes: How many to use at once; more than two are not faster.

    Raises:
        ValueError: If `processes` is not positive, if `YOLINO_KERNELS` forbids to compile, or what `load`
            raises.
        OSError: If they could not be kept on disk.
    """
    if os.environ.get(VARIABLE) == "interpreted":
        raise ValueError(
            f"{VARIABLE} is 'interpreted', so compiled kernels would never be used: unset it first."
        )
    if processes < 1:
        raise ValueError(f"processes is {processes}, but must be at least 1.")
    load(model, device="cpu", threads=1)  # a mistake is told here
    _find_place()
    context = multiprocessing.get_context(
        "spawn"
    )  # numba's lock and threads of the engine do not survive a fork
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        jobs = [pool.submit(_compile, job, str(model)) for job in JOBS]
        for done, job in enumerate(as_completed(jobs), 1):
            job.result()
            yield done / (len(jobs) + 1)
        pool.submit(_compile, _run_once, str(model)).result()
        yield 1.0


def check_kept() -> Path:
    """Gives the folder below which compiled kernels lie.

    Raises:
        OSError: If they do not.
    """
    place = _find_place()
    if not are_kept():
        raise OSError(
            f"The kernels are compiled, but were not kept in {place}: name another folder in {_NAMED}."
        )
    return place


def _find_place() -> Path:
    """Gives the folder below which numba keeps kernels.

    Raises:
        OSError: If there is none, or another than the one that the user named.
    """
    from yolino.postprocess.merging import suppress

    named = os.environ.get(_NAMED)
    try:
        folder = Path(suppress.dispatcher.stats.cache_path)
    except RuntimeError as error:  # numba found no folder that it can write
        raise OSError(
            "Kernels cannot be kept, because neither the folder of the package nor your cache folder can be "
            f"written: name a folder in {_NAMED}."
        ) from error
    if named and not folder.is_relative_to(named):  # numba has silently taken another
        raise OSError(
            f"Kernels cannot be kept in {named}, which {_NAMED} names, because it cannot be written: "
            "name another folder."
        )
    return folder.parents[1] if folder.name == "__pycache__" else folder.parent


def _compile(job: Callable[[str], None], model: str) -> None:
    with tier("compiled"):
        job(model)


def _line() -> Segments:
    """Gives segments along a line, two at each place."""
    steps = np.linspace(0.0, 1.0, 9)[:, None] * (0.0, -200.0) + (100.0, 200.0)
    return Segments(np.repeat(np.stack([steps[:-1], steps[1:]], axis=1), 2, axis=0))


__all__ = ["check_kept", "compile_ahead"]
