"""What is said while a sweep runs: which run, which step, how long it will take."""

import logging

import pytest

from yolino.sweep import load_sweep, plan
from yolino.sweep.progress import Progress, duration, listening


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (59.4, "59 s"), (61, "1 min"), (3599, "1 h 00 min"), (7500, "2 h 05 min")],
)
def test_times_are_for_people(seconds, text):
    assert duration(seconds) == text


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def jobs(folder, tmp_path):
    return plan(load_sweep(folder), ["training.steps=100"], tmp_path / "out")


def test_the_remaining_time_is_that_of_this_run_and_the_others(jobs, said):
    time = [0.0]
    progress = Progress(jobs, 3, said.append, now=lambda: time[0])
    progress.begin(2, jobs[0], 0)
    assert said == ["[2 of 3] a, seed 0: begins, 100 steps"]
    time[0] = 60.0
    progress.step(jobs[0], 25, "f1 0.5")
    assert said[-1] == "[2 of 3] a, seed 0: step 25 of 100, f1 0.5; about 3 min left, 7 min for all runs"
    time[0] = 240.0
    progress.end(jobs[0], "finished")
    progress.begin(3, jobs[1], 50)
    # The rate is that of the step before: 2.4 s.
    assert said[-1] == "[3 of 3] b, seed 0: goes on from step 50 of 100; about 2 min left"
    time[0] = 245.0
    progress.step(jobs[1], 55, "f1 0.6")
    assert said[-1] == "[3 of 3] b, seed 0: step 55 of 100, f1 0.6; about 45 s left"


def test_a_run_that_fails_at_once_gives_no_rate(jobs, said):
    progress = Progress(jobs, 2, said.append, now=lambda: 0.0)
    progress.begin(1, jobs[0], 0)
    progress.end(jobs[0], "failed: no")
    progress.begin(2, jobs[1], 0)
    assert said[-2:] == ["[1 of 2] a, seed 0: failed: no", "[2 of 2] b, seed 0: begins, 100 steps"]


def test_validations_are_taken_from_the_log_and_warnings_pass(jobs, said, caplog):
    logger = logging.getLogger("yolino.training.callbacks")
    before = (logger.level, logger.propagate, list(logger.handlers))
    progress = Progress(jobs, 2, said.append)
    progress.begin(1, jobs[0], 0)
    with listening(progress, jobs[0]):
        logger.info("step %d: %s", 50, "f1 0.250")
        logger.info("something else")
        logger.warning("careful")
    assert (logger.level, logger.propagate, logger.handlers) == before
    assert len(said) == 2
    assert said[1].startswith("[1 of 2] a, seed 0: step 50 of 100, f1 0.250")
    assert [record.getMessage() for record in caplog.records] == ["careful"]
