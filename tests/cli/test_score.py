"""`yolino score` on the command line: the forms that scripts rely on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from .conftest import Run

ROWS = list(range(160, 720, 10))


@pytest.fixture
def tusimple(tmp_path: Path) -> tuple[Path, Path]:
    """Predictions and labels of two images: all right, and one of two lanes right."""
    lanes = [[[300.0] * 56, [800.0] * 56], [[300.0] * 56, [800.0] * 56]]
    found = [lanes[0], [[300.0] * 56, [500.0] * 56]]
    paths = tmp_path / "predictions.json", tmp_path / "labels.json"
    for path, sides in zip(paths, (found, lanes), strict=True):
        records = [
            {"raw_file": f"clips/{i}/20.jpg", "lanes": side, "h_samples": ROWS, "run_time": 10}
            for i, side in enumerate(sides)
        ]
        path.write_text("".join(json.dumps(record) + "\n" for record in records))
    return paths


@pytest.fixture
def culane(tmp_path: Path) -> tuple[Path, Path]:
    """Two images; in the second a lane is missed and another is made up."""
    lanes = {"a/0": ["100 590 400 300", "900 590 800 300"], "b/1": ["100 590 400 300"]}
    found = {"a/0": lanes["a/0"][::-1], "b/1": ["1500 590 1200 300"]}
    for folder, sides in (("found", found), ("truth", lanes)):
        for name, lines in sides.items():
            path = tmp_path / folder / f"{name}.lines.txt"
            path.parent.mkdir(parents=True)
            path.write_text("".join(f"{line}\n" for line in lines))
    (tmp_path / "all.txt").write_text("/a/0.jpg\n/b/1.jpg\n")
    (tmp_path / "first.txt").write_text("/a/0.jpg\n")
    return tmp_path / "found", tmp_path / "truth"


def test_tusimple_gives_the_official_values(run: Run, tusimple: tuple[Path, Path]) -> None:
    code, out, err = run("score", "--metric", "tusimple", *tusimple, "--json")
    assert (code, err) == (0, "")
    scores = json.loads(out)
    assert {name: scores[name] for name in ("accuracy", "fp", "fn")} == {
        "accuracy": 0.75,
        "fp": 0.25,
        "fn": 0.25,
    }


def test_culane_gives_counts_and_ratios(run: Run, culane: tuple[Path, Path]) -> None:
    code, out, err = run("score", "--metric", "culane", *culane, "--list", "all.txt", "--json")
    assert (code, err) == (0, "")
    scores = json.loads(out)
    assert [scores[name] for name in ("tp", "fp", "fn")] == [2, 1, 1]
    assert [scores[name] for name in ("precision", "recall", "f1")] == pytest.approx([2 / 3] * 3)
    code, out, _ = run(
        "score", "--metric", "culane", *culane, "--list", "all.txt", "--iou", "0.999", "--json"
    )
    assert json.loads(out)["tp"] == 2
    code, out, _ = run(
        "score", "--metric", "culane", *culane, "--list", "all.txt", "--size", "295x820", "--json"
    )
    assert code == 0


def test_several_lists_are_categories(run: Run, culane: tuple[Path, Path]) -> None:
    lists = ["--list", "all.txt", "--list", "first.txt"]
    code, out, _ = run("score", "--metric", "culane", *culane, *lists, "--json")
    scores = json.loads(out)
    assert code == 0
    assert scores["categories"]["first"]["f1"] == 1
    assert scores["categories"]["all"]["f1"] == pytest.approx(2 / 3)


@pytest.mark.parametrize("metric", ["points", "chamfer", "frechet"])
def test_other_metrics_take_any_format(run: Run, culane: tuple[Path, Path], metric: str) -> None:
    size = ["--size", "590x1640"]
    code, out, err = run("score", "--metric", metric, *culane, *size, "--json", "--intervals")
    assert (code, err) == (0, "")
    scores = json.loads(out)
    assert scores["images"] == 2
    assert 0 < scores["f1"] < 1
    low, high = scores["intervals"]["f1"]
    assert low <= scores["f1"] <= high


def test_options_reach_the_metric(run: Run, culane: tuple[Path, Path]) -> None:
    found, truth = culane
    for path in found.rglob("*.txt"):  # turned round
        lines = [line.split() for line in path.read_text().splitlines()]
        path.write_text("".join(" ".join(line[2:] + line[:2]) + "\n" for line in lines))
    arguments = ["score", "--metric", "points", found, truth, "--size", "590x1640", "--json"]
    assert json.loads(run(*arguments)[1])["f1"] == 0
    undirected = json.loads(run(*arguments, "--undirected")[1])["f1"]
    assert 0 < undirected < 1
    wide = json.loads(run(*arguments, "--undirected", "--radius", "2000", "--set", "angle_radius=3.1")[1])[
        "f1"
    ]
    assert wide > undirected


def test_the_table_is_for_people(run: Run, culane: tuple[Path, Path]) -> None:
    code, out, _ = run("score", "--metric", "culane", *culane, "--list", "all.txt", "--list", "first.txt")
    assert code == 0
    assert "f1 mean" in out
    assert "first" in out


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--metric", "iou"], "The metric 'iou' is unknown; use one of points, tusimple"),
        (["--size", "590"], "--size is '590'; give HEIGHTxWIDTH in pixels, e.g. 590x1640."),
        (
            ["--set", "radios=3"],
            "--set 'radios=3' does not fit the metric 'points'; it takes KEY=VALUE with radius",
        ),
        (["--list", "none.txt"], "none.txt"),
        (["--format", "word"], "The dataset 'word' is unknown"),
        ([], "give --size HEIGHTxWIDTH"),
    ],
)
def test_mistakes_are_told(run: Run, culane: tuple[Path, Path], arguments: list[str], reason: str) -> None:
    code, out, err = run("score", *culane, *arguments)
    assert (code, out) == (2, "")
    assert reason in err
    assert err.count("\n") == 1


def test_broken_predictions_are_named(run: Run, culane: tuple[Path, Path]) -> None:
    (culane[0] / "b/1.lines.txt").write_text("1 2 x 4\n")
    code, _, err = run("score", "--metric", "culane", *culane)
    assert code == 2
    assert "1.lines.txt, line 1 holds 'x', but finite numbers are needed." in err


def test_classes_come_with_their_confusion_matrix(run: Run, tmp_path: Path) -> None:
    lines = {"solid": [[20, 90], [60, 10]], "dashed": [[150, 90], [120, 10]]}
    for side, names in (("truth", ("solid", "dashed")), ("found", ("solid", "solid"))):
        shapes = [
            {"label": name, "shape_type": "linestrip", "points": points}
            for name, points in zip(names, lines.values(), strict=True)
        ]
        (tmp_path / side).mkdir()
        document = {"imagePath": "a.jpg", "imageHeight": 100, "imageWidth": 200, "shapes": shapes}
        (tmp_path / side / "a.json").write_text(json.dumps(document))
    code, out, err = run("score", "--metric", "classes", "found", "truth", "--json")
    assert (code, err) == (0, "")
    scores = json.loads(out)
    assert scores["classes"] == ["dashed", "solid"]
    (dashed, solid), zero = (scores["confusion"][i][1] for i in (0, 1)), scores["confusion"]
    assert (zero[0][0], zero[1][0]) == (0, 0)
    assert scores["class_accuracy"] == pytest.approx(solid / (solid + dashed))
    code, out, _ = run("score", "--metric", "classes", "found", "truth")
    assert "labelled \\ predicted" in out


def test_a_radius_is_the_threshold_of_instances(run: Run, culane: tuple[Path, Path]) -> None:
    arguments = ["score", "--metric", "chamfer", *culane, "--size", "590x1640", "--json"]
    assert "ap_5px" in json.loads(run(*arguments, "--radius", "5")[1])
    assert "ap_1%" in json.loads(run(*arguments)[1])


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--metric", "culane", "--radius", "3"], "The metric 'culane' takes no --radius; it takes iou"),
        (["--metric", "points", "--iou", "0.3"], "The metric 'points' takes no --iou; it takes radius"),
        (["--set", "spacing=nan"], "spacing must be positive"),
    ],
)
def test_options_that_do_not_fit_are_told(
    run: Run, culane: tuple[Path, Path], arguments: list[str], reason: str
) -> None:
    code, out, err = run("score", *culane, "--size", "590x1640", *arguments)
    assert (code, out) == (2, "")
    assert reason in err


def test_a_folder_is_read_as_its_description_says(run: Run, culane: tuple[Path, Path]) -> None:
    (culane[1] / "data.yaml").write_text("format: culane\nclasses: [kerb]\n")
    code, _, err = run("score", *culane, "--size", "590x1640")
    assert code == 2
    assert "None of the classes kerb occurs" in err
