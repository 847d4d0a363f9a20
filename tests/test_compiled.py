"""Both tiers of the kernels give the same, and the right one is chosen."""

from __future__ import annotations

import copy
import logging
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
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
    ends = LINKERS["chain"](16.0, directed=directed, min_end_score=0.5, level_ends_cells=2.0)
    both(lambda: ends(merged))


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


def test_a_kernel_is_pickled_and_copied_as_a_function_is():
    assert pickle.loads(pickle.dumps(_ratios)) is _ratios
    assert copy.deepcopy(_ratios) is _ratios
    with pytest.raises(pickle.PicklingError):  # it has no name of its own
        pickle.dumps(compiled(_ratios.py_func))


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


class _Block:
    """A block in a thread of its own, which begins and ends when told."""

    def __init__(self, manager: Any) -> None:
        self.begun, self.end, self.given = threading.Event(), threading.Event(), None
        self._manager, self._thread = manager, threading.Thread(target=self._run)
        self._thread.start()
        assert self.begun.wait(10)

    def _run(self) -> None:
        with self._manager as self.given:
            self.begun.set()
            assert self.end.wait(10)

    def leave(self) -> None:
        self.end.set()
        self._thread.join()


def _interpreted() -> bool:
    return tiers._State.interpreted


def test_blocks_of_two_threads_end_in_any_order(free):
    free(True)
    default = _interpreted()
    for first, second in ((1, 1000), (1000, 1), (1, 1), (1000, 1000)):
        blocks = {"first": _Block(expected(first)), "second": _Block(expected(second))}
        assert _interpreted() == (first == second == 1)
        for name, block in blocks.items():
            block.leave()
            if name == "first":
                assert _interpreted() == (second == first == 1)
        assert _interpreted() == default
        assert tiers._State.claims == []


def test_a_promise_holds_until_its_block_ends(free):
    free(True)
    many = _Block(expected(1000))
    few = _Block(expected(1))  # the kernels are there anyway
    assert many.given
    assert few.given
    many.leave()
    assert not _interpreted()
    few.leave()


def test_nested_blocks_end_one_by_one(free):
    free(True)
    with expected(1):
        with tier("compiled"):
            assert not _interpreted()
        assert _interpreted()
        with tier("interpreted"):
            assert _interpreted()
        with pytest.raises(RuntimeError), expected(1000):
            raise RuntimeError
        assert _interpreted()


def test_what_was_counted_in_an_inner_block_counts_for_the_outer(free):
    free(True)
    with expected(1):
        with expected(1):
            reconsider(9_000)
        reconsider(6_000)
        assert _interpreted()
        with expected(1):
            reconsider(1)
            assert not _interpreted()
        assert not _interpreted()  # the wait is over, for the outer block, too


def test_kernels_stay_compiled_in_the_block_whose_thread_did_not_decide(free):
    free(False)
    patient = _Block(expected(1))
    free(True)
    hasty = _Block(expected(1))
    reconsider(15_001)
    hasty.leave()
    assert not _interpreted()
    patient.leave()


def test_threads_count_together_and_say_it_once(free, caplog):
    free(False)
    with caplog.at_level(logging.WARNING), expected(1), ThreadPoolExecutor(8) as pool:
        assert all(pool.map(lambda _: _interpreted(), range(8)))
        jobs = [pool.submit(lambda: [reconsider(15) for _ in range(1_250)]) for _ in range(8)]
        for job in jobs:
            job.result()
        assert _interpreted()
        assert [claim.left for claim in tiers._State.claims] == [0]
        jobs = [pool.submit(reconsider, 1) for _ in range(8)]
        for job in jobs:
            job.result()
        assert not any(pool.map(lambda _: _interpreted(), range(8)))
    assert len(caplog.records) == 1


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


_KEPT = "import yolino.compiled as tiers; print(tiers.are_kept())"


def test_what_is_on_disk_is_seen_where_numba_puts_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """By the name that numba gives a file, and only once a linker is there, too."""
    variables = {"NUMBA_CACHE_DIR": str(tmp_path)}
    assert _python(_KEPT, **variables).stdout == "False\n"
    compile_one = "import numpy; from yolino.postprocess.merging import powers; powers(numpy.ones(2), 2.0)"
    assert _python(compile_one, **variables, YOLINO_KERNELS="compiled").returncode == 0
    assert _python(_KEPT, **variables).stdout == "False\n"
    (made,) = tmp_path.glob("postprocess_*/*.powers.*.nbi")
    powers = tiers._root("merging:powers")
    end = made.name.partition(f"-{powers.py_func.__code__.co_firstlineno}.")[2]
    assert made.name.startswith(f"merging.powers.{powers.fingerprint[:12]}-")
    for name, kept in (("merging:suppress", "False\n"), ("tree:_link", "True\n")):
        _keep(made.parent, name, end)
        assert _python(_KEPT, **variables).stdout == kept
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(tiers._root("merging:suppress"), "fingerprint", "0" * 64)  # as after an upgrade
    assert not tiers.are_kept()


def _keep(folder: Path, name: str, end: str, **changed: Any) -> None:
    """Makes the file that numba would keep of a kernel."""
    kernel = tiers._root(name)
    mark = changed.get("fingerprint", kernel.fingerprint)[:12]
    line = changed.get("line", kernel.py_func.__code__.co_firstlineno)
    (folder / f"{name.replace(':', '.')}.{mark}-{line}.{end}").touch()


def test_files_of_another_version_do_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder, now = tmp_path / "postprocess_old", f"py{sys.version_info[0]}{sys.version_info[1]}.nbi"
    folder.mkdir()
    (folder / "stale.nbi").touch()
    for name in tiers.ROOTS:
        _keep(folder, name, now, fingerprint="0" * 12)
        _keep(folder, name, now, line=1)
        _keep(folder, name, "py310.nbi")
    assert not tiers.are_kept()
    for name in tiers.ROOTS[:2]:
        _keep(folder, name, now)
    assert tiers.are_kept()


def test_the_roots_are_what_predicting_calls():
    assert {name.partition(":")[0] for name in tiers.ROOTS} == {"merging", *LINKERS}
    assert all(isinstance(tiers._root(name), tiers._Kernel) for name in tiers.ROOTS)
