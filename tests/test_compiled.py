"""Both tiers of the kernels give the same, and the right one is chosen."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, no_type_check

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino import compiled as tiers
from yolino.compiled import compiled, expected, reconsider, tier
from yolino.postprocess import LINKERS, NMS
from yolino.postprocess.thresholding import segments_above
from yolino.types import Segments


def assert_same(one: Any, two: Any) -> None:
    """Compares all arrays of two values, bit for bit."""
    for name in vars(one):
        a, b = getattr(one, name), getattr(two, name)
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_array_equal(np.asarray(a), np.asarray(b), err_msg=name)


def both(step: Callable[[], Any]) -> Any:
    """Gives what a step gives as machine code, which must be what it gives as plain Python."""
    with tier("compiled"):
        result = step()
    with tier("interpreted"):
        assert_same(step(), result)
    return result


def scene(seed: int, lines: int, *, classes: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Makes what a network says of bent lines that may cross: two noisy candidates a cell, and noise."""
    rng = np.random.default_rng(seed)
    pieces = [rng.uniform(0, 200, (10, 2, 2)), np.full((2, 2, 2), 50.0)]
    for _ in range(lines):
        way, bend = rng.uniform(-np.pi, np.pi), rng.normal(0, 0.05)
        angles = way + bend * np.arange(16)
        steps = 12 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points = rng.uniform(40, 160, 2) + np.cumsum(steps, axis=0)
        pieces.append(np.repeat(np.stack([points[:-1], points[1:]], axis=1), 2, axis=0))
    endpoints = np.concatenate(pieces)
    endpoints += rng.normal(0, 0.5, endpoints.shape)
    scores = rng.uniform(0, 1, len(endpoints))
    shares = rng.dirichlet(np.ones(3), len(endpoints)).astype(np.float32) if classes else None
    return endpoints.astype(np.float32), scores.astype(np.float32), shares


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 5), st.booleans(), st.booleans(), st.floats(0, 1))
def test_both_tiers_give_the_same_lines(seed, lines, classes, directed, threshold):
    given = scene(seed, lines, classes=classes)
    found = both(lambda: segments_above(*given, threshold))
    assert isinstance(found, Segments)
    for options in ({}, {"weighted": True, "min_samples": 1}, {"min_samples": 3}):
        nms = NMS(16.0, directed=directed, **options)
        merged = both(lambda nms=nms: nms(found))
    for kind in LINKERS.values():
        linker = kind(16.0, directed=directed)
        both(lambda linker=linker: linker(merged))
        both(lambda linker=linker: linker(found))


@compiled(inline=True)
@no_type_check
def _ratio(a, b):
    return a / b


@compiled
@no_type_check
def _ratios(values):
    """Divides each value by the one before."""
    found = np.empty(len(values) - 1)
    for i in range(len(found)):
        found[i] = _ratio(values[i + 1], values[i])
    return found


def test_kernels_divide_by_zero_as_numpy_does_and_say_nothing():
    for name in ("compiled", "interpreted"):
        with tier(name):
            np.testing.assert_array_equal(_ratios(np.array([0.0, 1.0, 0.0, 0.0])), [np.inf, 0.0, np.nan])


def test_a_kernel_keeps_its_name_and_text():
    assert _ratios.__name__ == "_ratios"
    assert _ratios.__doc__ == "Divides each value by the one before."
    assert _ratios.__wrapped__ is _ratios.py_func


def test_what_a_kernel_calls_is_part_of_its_fingerprint():
    """Else machine code on disk would outlive a change in another file."""
    before = compiled(_ratios.py_func).fingerprint
    assert before == _ratios.fingerprint
    scope = dict(_ratios.py_func.__globals__, _ratio=compiled(lambda a, b: b / a))
    function = type(_ratios.py_func)(_ratios.py_func.__code__, scope)
    assert compiled(function).fingerprint != before
    assert compiled(inline=True)(_ratios.py_func).fingerprint != before


def test_threads_that_meet_at_the_first_call_share_one_dispatcher():
    kernel = compiled(_ratio.py_func)
    start, seen = threading.Barrier(8), []

    def call() -> None:
        start.wait()
        seen.append((kernel(6.0, 3.0), id(kernel.dispatcher)))

    threads = [threading.Thread(target=call) for _ in range(8)]
    with tier("compiled"):
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert set(seen) == {(2.0, id(kernel.dispatcher))}


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], None]:
    """Lets the tier be chosen, as if numba were not loaded and compiled kernels on disk or not."""

    def prepare(kept: bool) -> None:
        monkeypatch.setattr(tiers, "are_kept", lambda: kept)
        monkeypatch.delitem(sys.modules, "numba", raising=False)
        monkeypatch.setattr(tiers._State, "choice", "auto")

    return prepare


def test_few_images_are_left_to_python(free):
    for kept, few, many in ((True, 21, 22), (False, 214, 215)):
        free(kept)
        with expected(few) as machine_code:
            assert not machine_code
        with expected(many) as machine_code:
            assert machine_code


def test_kernels_are_compiled_after_all_when_images_show_more_than_usual(free, caplog):
    for kept, many in ((True, 15_000), (False, 150_000)):
        free(kept)
        caplog.clear()
        with caplog.at_level(logging.WARNING), expected(1):
            reconsider(many)
            assert tiers._State.interpreted
            reconsider(1)
            assert not tiers._State.interpreted
        assert [record.name for record in caplog.records] == ["yolino.compiled"] * (not kept)


def test_the_tier_is_that_of_before_after_the_work(free):
    free(True)
    before = tiers._State.interpreted
    with expected(1), expected(1000) as machine_code:
        assert machine_code
    assert tiers._State.interpreted == before


def _python(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if key != tiers.VARIABLE} | variables
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


_MERGE = """
import sys, numpy as np, yolino.compiled as tiers
from yolino.postprocess import NMS
from yolino.types import Segments
with tiers.expected(IMAGES):
    NMS(16.0)(Segments(np.ones((2, 2, 2))))
print("numba" in sys.modules)
"""


def test_a_variable_forces_a_tier():
    many, one = _MERGE.replace("IMAGES", "9999"), _MERGE.replace("IMAGES", "1")
    assert _python(many, YOLINO_KERNELS="interpreted").stdout == "False\n"
    assert _python(one, YOLINO_KERNELS="compiled").stdout == "True\n"
    assert _python(one).stdout == "False\n"
    failed = _python(one, YOLINO_KERNELS="fast")
    assert failed.stderr.splitlines()[-1] == (
        "ValueError: YOLINO_KERNELS is 'fast', but must be one of auto, compiled, interpreted."
    )


def test_what_is_on_disk_is_seen_where_numba_puts_it(tmp_path: Path):
    code = "import yolino.compiled as tiers; print(tiers.are_kept())"
    variables = {"NUMBA_CACHE_DIR": str(tmp_path)}
    assert _python(code, **variables).stdout == "False\n"
    compile_one = "import numpy; from yolino.postprocess.merging import powers; powers(numpy.ones(2), 2.0)"
    assert _python(compile_one, **variables, YOLINO_KERNELS="compiled").returncode == 0
    assert _python(code, **variables).stdout == "True\n"
