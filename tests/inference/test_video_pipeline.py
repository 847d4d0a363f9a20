from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.inference.video_pipeline import Channel, Package, Pipeline, Step


@pytest.fixture(autouse=True)
def _no_thread_is_left() -> Iterator[None]:
    yield
    deadline = time.monotonic() + 2
    while own_threads() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert own_threads() == []


def own_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("yolino-")]


def wait(seconds: float) -> Callable[[int], int]:
    def work(item: int) -> int:
        time.sleep(seconds)
        return item

    return work


def gather(pipeline: Pipeline) -> tuple[list[int], Exception | None]:
    """Takes all results, and the exception that ended the run."""
    results: list[int] = []
    try:
        for item in pipeline:
            results.append(item)
    except Exception as error:
        return results, error
    return results, None


@given(st.lists(st.integers(), max_size=20), st.integers(1, 4), st.integers(1, 3))
@settings(max_examples=25, deadline=None)
def test_the_results_are_those_of_one_step_after_the_other(items: list[int], steps: int, depth: int) -> None:
    work = [Step(f"add {k}", lambda item, k=k: item * 2 + k) for k in range(steps)]
    expected = items
    for step in work:
        expected = [step.work(item) for item in expected]
    assert list(Pipeline(items, work, depth=depth)) == expected


def test_the_steps_overlap() -> None:
    pipeline = Pipeline(range(20), [Step("a", wait(0.02)), Step("b", wait(0.02)), Step("c", wait(0.02))])
    start = time.perf_counter()
    assert list(pipeline) == list(range(20))
    taken = time.perf_counter() - start
    assert taken < 0.75 * 20 * 3 * 0.02
    assert all(0.4 <= pipeline.seconds[name] < taken for name in "abc")


def test_a_slow_step_makes_those_before_it_wait() -> None:
    ahead, most = [0, 0], []

    def source() -> Iterator[int]:
        for i in range(12):
            ahead[0] += 1
            yield i

    def slow(item: int) -> int:
        time.sleep(0.01)
        most.append(ahead[0] - item)
        return item

    assert list(Pipeline(source(), [Step("slow", slow)], depth=2)) == list(range(12))
    assert max(most) <= 4  # two wait in the queue, one before it, one is worked on


def test_a_step_that_fails_ends_the_run_after_the_results_before_it() -> None:
    def fail(item: int) -> int:
        if item == 3:
            raise KeyError("three")
        return item

    results, error = gather(Pipeline(range(1000), [Step("fail", fail), Step("b", wait(0.001))]))
    assert results == [0, 1, 2]
    assert isinstance(error, KeyError)


def test_a_source_that_fails_ends_the_run_after_the_results_before_it() -> None:
    def source() -> Iterator[int]:
        yield from range(5)
        raise OSError("the cable")

    results, error = gather(Pipeline(source(), [Step("a", wait(0.001))]))
    assert results == [0, 1, 2, 3, 4]
    assert isinstance(error, OSError)


def test_who_stops_taking_results_ends_all_threads_and_the_source_is_given_back() -> None:
    given_back = []

    def source() -> Iterator[int]:
        try:
            yield from range(10**9)
        finally:
            given_back.append(threading.current_thread().name)

    results = iter(Pipeline(source(), [Step("a", wait(0)), Step("b", wait(0))]))
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    results.close()  # type: ignore[attr-defined]
    assert own_threads() == []
    assert given_back == ["yolino-reading"]


def test_stop_finishes_what_is_under_way() -> None:
    pipeline = Pipeline(iter(range(10**9)), [Step("a", wait(0)), Step("b", wait(0.002))])
    seen = []
    for item in pipeline:
        seen.append(item)
        if item == 10:
            pipeline.stop()
    assert seen == list(range(len(seen)))
    assert 11 <= len(seen) < 20


def test_stop_does_not_wait_for_a_source_that_hangs() -> None:
    hang = threading.Event()

    def source() -> Iterator[int]:
        yield 1
        hang.wait(10)

    pipeline = Pipeline(source(), [Step("a", wait(0))])
    threading.Timer(0.1, pipeline.stop).start()
    threading.Timer(0.6, hang.set).start()
    start = time.perf_counter()
    assert list(pipeline) == [1]
    assert time.perf_counter() - start < 3


def test_the_latest_item_wins_where_the_steps_are_slow() -> None:
    def source() -> Iterator[int]:
        for i in range(40):
            time.sleep(0.002)
            yield i

    pipeline = Pipeline(source(), [Step("slow", wait(0.02))], latest=True, depth=1)
    seen = list(pipeline)
    assert seen == sorted(set(seen))
    assert seen[-1] == 39
    assert len(seen) < 25
    assert pipeline.dropped == 40 - len(seen)


def test_a_channel_keeps_the_error_where_it_drops_items() -> None:
    channel = Channel(1, latest=True)
    for item in (1, 2):
        assert channel.put(Package(item))
    assert channel.put(Package(None, OSError("gone")))
    channel.end()
    first, second = channel.get(), channel.get()
    assert first is not None
    assert first.item == 2
    assert second is not None
    assert isinstance(second.error, OSError)
    assert channel.get() is None
    assert channel.dropped == 1


def test_nobody_puts_into_or_gets_from_a_closed_channel() -> None:
    channel = Channel(2)
    assert channel.put(Package(1))
    channel.close()
    assert not channel.put(Package(2))
    assert channel.get() is None


def test_a_pipeline_needs_steps_and_room() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        Pipeline([], [])
    with pytest.raises(ValueError, match="at least 1"):
        Pipeline([], [Step("a", wait(0))], depth=0)
