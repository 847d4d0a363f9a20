"""Runs of classes are the best of all that are long enough."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.postprocess.class_runs import class_runs


def value(runs: tuple[int, ...], lengths: np.ndarray, votes: np.ndarray, shortest: float) -> float:
    """The votes of a labelling less the price of its changes; minus infinity if a run is too short."""
    price = 0.25 * shortest * votes.sum() / lengths.sum()
    cuts = [i for i in range(1, len(runs)) if runs[i] != runs[i - 1]]
    bounds = [0, *cuts, len(runs)]
    if cuts and min(lengths[a:b].sum() for a, b in pairwise(bounds)) < shortest - 1e-12:
        return -np.inf
    return sum(votes[i, k] for i, k in enumerate(runs)) - price * len(cuts)


@settings(deadline=None, max_examples=80)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 7), classes=st.integers(1, 3), shortest=st.floats(0.3, 4))
def test_no_other_runs_have_more_votes(seed: int, n: int, classes: int, shortest: float) -> None:
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.2, 1.5, n)
    votes = rng.dirichlet(np.full(classes, 0.4), n) * lengths[:, None]
    found = class_runs(lengths, votes, shortest)
    best = max(value(runs, lengths, votes, shortest) for runs in product(range(classes), repeat=n))
    assert value(tuple(found.tolist()), lengths, votes, shortest) == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        ("AAAAAAAA", "AAAAAAAA"),
        ("AAAABBBB", "AAAABBBB"),
        ("AAAABAAA", "AAAAAAAA"),
        ("AABABBBB", "AAABBBBB"),
        ("BAAAAAAA", "AAAAAAAA"),
        ("AB", "AA"),
        ("AAABBBAAA", "AAABBBAAA"),
        ("AAABBAAA", "AAAAAAAA"),
    ],
)
def test_single_segments_of_another_class_are_smoothed_away(labels: str, expected: str) -> None:
    votes = np.array([[label == "A", label == "B"] for label in labels], float)
    found = class_runs(np.ones(len(labels)), votes, 3.0)
    named = "".join("AB"[k] for k in found)
    if labels == "AABABBBB":  # two ways are equally good
        assert named in ("AAABBBBB", "AAAABBBB")
        return
    assert named == expected


def test_segments_without_score_have_some_class() -> None:
    assert class_runs(np.ones(4), np.zeros((4, 2)), 2.0).tolist() == [0, 0, 0, 0]
