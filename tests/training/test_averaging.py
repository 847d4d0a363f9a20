"""The average of several trainings is the mean of their weights, with statistics and scores of its own."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from yolino.config import load_experiment
from yolino.header import Header
from yolino.model.checkpoint import load_checkpoint, save_checkpoint
from yolino.training import averaging
from yolino.training.averaging import LEAST_SHARE, average, joined_parts, mean_weights, measure_statistics
from yolino.training.loaders import Batches, build_loaders
from yolino.training.module import TrainingModule, network_arguments
from yolino.training.run import train

TEXT = """
name: tiny
data:
  size: [64, 96]
  train: [{dataset: synthetic, options: {kind: shapes, length: 50, size: [64, 96]}}]
  val: [{dataset: synthetic, options: {kind: shapes, length: 3, seed: 9, size: [64, 96]}}]
  licence: none
  description: drawn shapes
model:
  backbone: residual
  backbone_args: {widths: [8, 8, 16, 16], blocks: [1, 1, 1, 1], stem: 4}
  neck_width: 16
  predictors: 4
augment: {preset: none}
training:
  {steps: 2, batch_size: 2, validate_every: 2, warmup_steps: 1, accelerator: cpu, devices: 1, workers: 0}
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with an experiment file, a run, and two runs of other seeds that began from it."""
    folder = tmp_path_factory.mktemp("averaging")
    config = folder / "tiny.yaml"
    config.write_text(TEXT)
    start = train(config, [f"out={folder}", "name=start"], progress=False)
    for seed in (1, 2):
        changes = [
            f"name=end_{seed}",
            f"training.seed={seed}",
            f"training.start_from={start}",
            "training.lr=0.01",
        ]
        train(config, [f"out={folder}", *changes], progress=False)
    return folder


@pytest.fixture
def ends(runs: Path) -> list[Path]:
    return [runs / name / "last.safetensors" for name in ("end_1", "end_2")]


@pytest.fixture(autouse=True)
def lenient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two steps teach a network nothing: what it finds, and its average, is chance."""
    monkeypatch.setattr(averaging, "LEAST_SHARE", 0.0)


class TestMeanWeights:
    def test_a_hand_computed_mean(self) -> None:
        first = {"w": torch.tensor([1.0, 2.0]), "seen": torch.tensor(7)}
        second = {"w": torch.tensor([2.0, 6.0]), "seen": torch.tensor(9)}
        mean = mean_weights([first, second])
        assert mean["w"].tolist() == [1.5, 4.0]
        assert mean["w"].dtype == torch.float32
        assert mean["seen"].item() == 7

    @given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=1, max_size=6))
    def test_it_lies_between_the_members_and_order_does_not_matter(self, values: list[float]) -> None:
        members = [{"w": torch.tensor([value])} for value in values]
        mean = mean_weights(members)["w"].item()
        assert min(values) <= mean <= max(values)
        assert mean_weights(members[::-1])["w"].item() == pytest.approx(mean, rel=1e-6, abs=1e-6)

    def test_many_equal_weights_stay_what_they_are(self) -> None:
        weights = {"w": torch.rand(50)}
        assert torch.equal(mean_weights([weights] * 7)["w"], weights["w"])


class TestAverage:
    def test_the_file_holds_the_mean_weights(self, ends: list[Path], tmp_path: Path) -> None:
        done = average(ends, tmp_path / "mean.safetensors", images=4)
        mean, _ = load_checkpoint(done.path)
        first, second = (load_checkpoint(end)[0].state_dict() for end in ends)
        found, moved = mean.state_dict(), False
        for name, _ in mean.named_parameters():
            torch.testing.assert_close(found[name], (first[name] + second[name]) / 2)
            moved |= not torch.equal(first[name], second[name])
        assert moved, "both runs ended with the same weights: the test shows nothing"

    def test_members_have_the_scores_that_their_training_wrote(
        self, ends: list[Path], tmp_path: Path
    ) -> None:
        done = average(ends, tmp_path / "mean.safetensors", images=4)
        for end, scores in zip(ends, done.members, strict=True):
            written = load_checkpoint(end)[1].metrics
            assert dict(scores) == {name: written[name] for name in scores}

    def test_the_header_says_what_it_is(self, ends: list[Path], tmp_path: Path) -> None:
        done = average(ends, tmp_path / "mean.safetensors", images=4, overrides=["name=mine"])
        header = load_checkpoint(done.path)[1]
        assert (header.name, header.licence, header.data) == ("mine", "none", "drawn shapes")
        assert header.metrics == {**done.scores, "averaged": 2}
        assert header.postprocess["threshold"] == done.scores["threshold"]

    def test_licences_and_data_of_all_members_are_named(self, ends: list[Path], tmp_path: Path) -> None:
        other = changed(ends[1], tmp_path / "other.safetensors", licence="MIT", data="photos")
        done = average([*ends, other], tmp_path / "mean.safetensors", images=4)
        header = load_checkpoint(done.path)[1]
        assert (header.licence, header.data) == ("none; MIT", "drawn shapes; photos")

    @pytest.mark.parametrize(
        ("texts", "joined"),
        [
            (["none", "none"], "none"),
            (["none; MIT", "MIT"], "none; MIT"),
            (["unknown", "MIT"], "MIT"),
            (["unknown", "unknown"], "unknown"),
        ],
    )
    def test_each_part_is_named_once(self, texts: list[str], joined: str) -> None:
        assert joined_parts(texts) == joined

    def test_the_same_twice(self, ends: list[Path], tmp_path: Path) -> None:
        first, second = (
            load_checkpoint(average(ends, tmp_path / name, images=4).path)[0].state_dict()
            for name in ("a.safetensors", "b.safetensors")
        )
        assert all(torch.equal(tensor, second[name]) for name, tensor in first.items())

    def test_training_goes_on_from_it(self, runs: Path, ends: list[Path], tmp_path: Path) -> None:
        mean = average(ends, tmp_path / "mean.safetensors", images=4).path
        changes = [f"out={tmp_path}", "name=more", f"training.start_from={mean}", "training.steps=1"]
        assert train(runs / "tiny.yaml", changes, progress=False).is_file()

    def test_progress_is_told(self, ends: list[Path], tmp_path: Path) -> None:
        seen = []

        def progress(indices: Any, title: str) -> Any:
            for i in indices:
                seen.append((title, i))
                yield i

        average(ends, tmp_path / "mean.safetensors", images=5, progress=progress)
        # Five images are three batches of two.
        assert [i for title, i in seen if title == "Scoring each"] == [0, 1]
        assert [i for title, i in seen if title != "Scoring each"] == [0, 1, 2]


class TestStatistics:
    def test_of_the_first_layer_against_a_literal_twin(self, runs: Path) -> None:
        module, loader = build(runs)
        measure_statistics(module, loader, 3)
        net = module.network
        convolution, norm = first_pair(net)
        images = [batch.images.float() for batch in itertools.islice(loader, 3)]
        with torch.no_grad():
            features = [convolution((batch - net.pixel_mean) / net.pixel_std) for batch in images]
        means = torch.stack([one.mean(dim=(0, 2, 3)) for one in features]).mean(0)
        spreads = torch.stack([one.var(dim=(0, 2, 3)) for one in features]).mean(0)
        torch.testing.assert_close(norm.running_mean, means, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(norm.running_var, spreads, rtol=1e-4, atol=1e-5)

    def test_nothing_else_changes(self, runs: Path) -> None:
        module, loader = build(runs)
        before = {name: tensor.clone() for name, tensor in module.network.named_parameters()}
        _, norm = first_pair(module.network)
        momentum = norm.momentum
        measure_statistics(module, loader, 1)
        assert all(torch.equal(before[name], tensor) for name, tensor in module.network.named_parameters())
        assert norm.momentum == momentum is not None
        assert not module.network.training

    def test_frozen_parts_keep_theirs(self, runs: Path) -> None:
        module, loader = build(runs, "training.freeze=[backbone]")
        _, norm = first_pair(module.network)
        before = norm.running_mean.clone()
        others = [n for n in module.network.neck.modules() if isinstance(n, torch.nn.BatchNorm2d)]
        neck = others[0].running_mean.clone()
        measure_statistics(module, loader, 2)
        assert torch.equal(before, norm.running_mean)
        assert not torch.equal(neck, others[0].running_mean)

    def test_all_but_the_normalization_works_as_in_use(self, runs: Path) -> None:
        module, loader = build(runs)
        modes: list[bool] = []
        module.network.head.register_forward_hook(lambda part, *_: modes.append(part.training))
        measure_statistics(module, loader, 1)
        assert modes == [False]  # dropout would be on in a part that trains

    def test_a_damaged_image_is_named_without_the_traceback_of_its_worker(
        self, runs: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def damaged(_: Batches) -> Iterator[Any]:
            raise ValueError("Caught ValueError in worker 0.\nTraceback:\nValueError: a.jpg is damaged.")
            yield

        module, loader = build(runs)
        monkeypatch.setattr(Batches, "__iter__", damaged)
        with pytest.raises(ValueError, match=r"^a\.jpg is damaged\.$"):
            measure_statistics(module, loader, 1)


class TestMistakes:
    def test_too_few(self, ends: list[Path], tmp_path: Path) -> None:
        with pytest.raises(ValueError, match="two or more checkpoints, but was given 1"):
            average(ends[:1], tmp_path / "mean.safetensors")

    def test_one_twice(self, ends: list[Path], tmp_path: Path) -> None:
        with pytest.raises(ValueError, match="is given twice"):
            average([*ends, ends[0]], tmp_path / "mean.safetensors")

    def test_one_by_two_names(self, ends: list[Path], tmp_path: Path) -> None:
        (tmp_path / "link.safetensors").symlink_to(ends[0])
        with pytest.raises(ValueError, match="is given twice"):
            average([*ends, tmp_path / "link.safetensors"], tmp_path / "mean.safetensors")

    def test_an_exported_model(self, ends: list[Path], tmp_path: Path) -> None:
        (tmp_path / "lanes.onnx").write_bytes(b"anything")
        with pytest.raises(ValueError, match=r"lanes\.onnx is no checkpoint"):
            average([*ends, tmp_path / "lanes.onnx"], tmp_path / "mean.safetensors")

    def test_another_ending(self, ends: list[Path], tmp_path: Path) -> None:
        with pytest.raises(ValueError, match=r"must be a file that ends in \.safetensors"):
            average(ends, tmp_path / "mean.onnx")

    def test_its_own_source(self, ends: list[Path]) -> None:
        before = ends[0].read_bytes()
        for spelled in (ends[0], ends[0].parent / ".." / ends[0].parent.name / ends[0].name):
            with pytest.raises(ValueError, match="would overwrite its source"):
                average(ends, spelled)
        assert ends[0].read_bytes() == before

    def test_a_folder_in_the_place_of_the_average(self, ends: list[Path], tmp_path: Path) -> None:
        (tmp_path / "mean.safetensors").mkdir()
        with pytest.raises(ValueError, match="must be a file"):
            average(ends, tmp_path / "mean.safetensors")

    def test_a_folder_instead_of_a_checkpoint(self, ends: list[Path], tmp_path: Path) -> None:
        with pytest.raises(ValueError, match=r"end_1 is no checkpoint: give the last\.safetensors"):
            average([ends[0].parent, ends[1]], tmp_path / "mean.safetensors")

    def test_a_training_that_failed(self, ends: list[Path], tmp_path: Path) -> None:
        broken = changed(ends[1], tmp_path / "broken.safetensors", weight=float("nan"))
        with pytest.raises(ValueError, match="weights that are not finite"):
            average([ends[0], broken], tmp_path / "mean.safetensors")

    def test_a_missing_checkpoint(self, ends: list[Path], tmp_path: Path) -> None:
        with pytest.raises(FileNotFoundError, match=r"none\.safetensors does not exist"):
            average([ends[0], tmp_path / "none.safetensors"], tmp_path / "mean.safetensors")

    def test_no_experiment_file(self, ends: list[Path], tmp_path: Path) -> None:
        alone = tmp_path / "alone.safetensors"
        alone.write_bytes(ends[0].read_bytes())
        with pytest.raises(FileNotFoundError, match="name its experiment file with --config"):
            average([alone, ends[1]], tmp_path / "mean.safetensors")

    def test_classes_that_mean_something_else(self, ends: list[Path], tmp_path: Path) -> None:
        other = changed(ends[1], tmp_path / "other.safetensors", directed=False)
        with pytest.raises(ValueError, match=r"directed False, but .* has True: only networks of one kind"):
            average([ends[0], other], tmp_path / "mean.safetensors")

    def test_another_network(self, runs: Path, ends: list[Path], tmp_path: Path) -> None:
        changes = [f"out={tmp_path}", "name=wide", "model.neck_width=24", "training.steps=1"]
        wide = train(runs / "tiny.yaml", changes, progress=False)
        with pytest.raises(
            ValueError, match=r"different networks \(they differ in .*\): only networks of one"
        ):
            average([ends[0], wide], tmp_path / "mean.safetensors")

    def test_an_average_that_finds_less_than_the_best_is_not_written(
        self, ends: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(averaging, "LEAST_SHARE", LEAST_SHARE)
        # Networks that find something take minutes to train, so the scores are made up.
        scores = iter([0.9, 0.0, 0.85])
        monkeypatch.setattr(
            averaging, "validate", lambda *_: {"line_f1": next(scores), "f1": 0.5, "threshold": 0.5}
        )
        with pytest.raises(ValueError, match=r"F1 of lines 0\.850\) than the best .* \(0\.900, 0\.000\)"):
            average(ends, tmp_path / "mean.safetensors", images=2)
        assert not list(tmp_path.iterdir())


def changed(source: Path, to: Path, weight: float | None = None, **values: Any) -> Path:
    """Copies a checkpoint with another header, or with one other weight."""
    network, header = load_checkpoint(source)
    if weight is not None:
        next(network.parameters()).data.view(-1)[0] = weight
    experiment = load_experiment(source.parent / "experiment.yaml")
    header = Header.from_json(header.to_json())
    for key, value in values.items():
        object.__setattr__(header, key, value)
    save_checkpoint(to, network.state_dict(), header, network_arguments(experiment))
    return to


def build(runs: Path, *changes: str) -> tuple[TrainingModule, Any]:
    experiment = load_experiment(runs / "tiny.yaml", [f"out={runs}", *changes])
    module = TrainingModule(experiment)
    loader, _ = build_loaders(experiment, border=module.network.representation.to_border)
    return module, loader


def first_pair(network: torch.nn.Module) -> tuple[torch.nn.Conv2d, torch.nn.BatchNorm2d]:
    convolution = next(m for m in network.modules() if isinstance(m, torch.nn.Conv2d))
    return convolution, next(m for m in network.modules() if isinstance(m, torch.nn.BatchNorm2d))
