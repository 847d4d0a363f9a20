"""Training learns, is deterministic, and goes on after a kill as if nothing had happened."""

import csv
import logging
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from safetensors.torch import load_file

from yolino.config import Source, load_experiment
from yolino.datasets import Synthetic
from yolino.datasets.convert import convert
from yolino.grid import Grid
from yolino.model.checkpoint import load_checkpoint
from yolino.model.network import Network
from yolino.model.representations import REPRESENTATIONS
from yolino.training.augment import Augment
from yolino.training.data import EndlessSampler, Examples, build_augment, build_dataset, collate_examples
from yolino.training.loaders import build_loaders
from yolino.training.losses import Criterion
from yolino.training.module import TrainingModule, learning_rate_factor
from yolino.training.run import train
from yolino.types import Polylines, Sample

TEXT = """
# A very small experiment on synthetic shapes.
name: tiny
data:
  size: [64, 96]
  train: [{dataset: synthetic, options: {kind: shapes, length: 50, size: [64, 96]}}]
  val: [{dataset: synthetic, options: {kind: shapes, length: 3, seed: 9, size: [64, 96]}}]
model:
  backbone: residual
  backbone_args: {widths: [8, 8, 16, 16], blocks: [1, 1, 1, 1], stem: 4}
  neck_width: 16
  predictors: 4
augment: {preset: none}
training:
  {steps: 4, batch_size: 2, validate_every: 2, warmup_steps: 1, ema_decay: 0.5, accelerator: cpu, devices: 1}
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.yaml"
    path.write_text(TEXT)
    return path


def run(config: Path, out: Path, *changes: str) -> dict[str, torch.Tensor]:
    best = train(config, [f"out={out}", *changes], progress=False)
    load_checkpoint(best)
    last = torch.load(out / "tiny" / "last.ckpt", weights_only=True)
    return last["state_dict"]


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")
class TestRuns:
    def test_a_resumed_run_equals_an_uninterrupted_one(self, config, tmp_path):
        whole = run(config, tmp_path / "whole")
        run(config, tmp_path / "parts", "training.steps=2")
        # The schedule of the first part ended early; only the data and the optimizer are compared below.
        parts = run(config, tmp_path / "parts")
        with (tmp_path / "parts" / "tiny" / "experiment.yaml").open() as file:
            assert "steps: 4" in file.read()
        assert set(whole) == set(parts)
        again = run(config, tmp_path / "again")
        for name, tensor in whole.items():
            assert torch.equal(tensor, again[name]), f"{name} differs between two runs with one seed"

    def test_a_kill_between_two_checkpoints_costs_nothing_but_time(
        self, config, tmp_path, monkeypatch, caplog
    ):
        whole = run(config, tmp_path / "whole")

        from yolino.training.module import TrainingModule

        step, count = TrainingModule.training_step, [0]

        def killed(self, batch, batch_idx):
            count[0] += 1
            if count[0] == 4:
                raise KeyboardInterrupt
            return step(self, batch, batch_idx)

        with monkeypatch.context() as patch:
            patch.setattr(TrainingModule, "training_step", killed)
            with pytest.raises((KeyboardInterrupt, SystemExit)):
                train(config, [f"out={tmp_path / 'killed'}"], progress=False)
        assert not list((tmp_path / "killed").rglob("*.part"))
        assert "the same command goes on from" in caplog.text
        resumed = run(config, tmp_path / "killed")
        assert (
            len(list((tmp_path / "killed").rglob("metrics.csv"))) == 2
        )  # the history before the kill is kept
        for name, tensor in whole.items():
            torch.testing.assert_close(tensor, resumed[name], msg=f"{name} differs after the kill")

    def test_the_last_step_is_validated_and_a_run_goes_on_from_it(self, config, tmp_path, caplog):
        # A warm-up that does not end: else the rates depend on the number of steps.
        changes = ["training.validate_every=3", "training.warmup_steps=100"]
        with caplog.at_level("INFO", logger="yolino"):
            run(config, tmp_path / "parts", "training.steps=2", *changes)
        assert "step 2: " in caplog.text
        assert load_checkpoint(tmp_path / "parts" / "tiny" / "best.safetensors")[1].metrics["step"] == 2
        parts = run(config, tmp_path / "parts", "training.steps=5", *changes)
        whole = run(config, tmp_path / "whole", "training.steps=5", *changes)
        for name, tensor in whole.items():
            torch.testing.assert_close(tensor, parts[name], msg=f"{name} differs after going on")

    def test_lightning_advertises_nothing(self, config, tmp_path, caplog, monkeypatch):
        caplog.set_level("INFO", logger="lightning.pytorch")  # as before the first run of this process
        monkeypatch.setattr(logging.getLogger("lightning.pytorch"), "propagate", True)
        run(config, tmp_path, "training.steps=1")
        assert "litlogger" not in caplog.text
        assert "GPU available" not in caplog.text

    def test_another_experiment_of_the_same_name_is_refused(self, config, tmp_path):
        run(config, tmp_path)
        with pytest.raises(ValueError, match=r"other settings \(training\.lr\)"):
            train(config, [f"out={tmp_path}", "training.lr=0.5"], progress=False)

    def test_fine_tuning_begins_with_the_weights_of_a_checkpoint(self, config, tmp_path):
        run(config, tmp_path)
        best = tmp_path / "tiny" / "best.safetensors"
        changes = [
            f"out={tmp_path / 'tuned'}",
            f"training.start_from={best}",
            "training.lr=1e-12",
            "training.ema_decay=0",
        ]
        tuned = load_file(train(config, [*changes, "training.weight_decay=0"], progress=False))
        for name, tensor in load_file(best).items():
            if "running" not in name and "num_batches" not in name:
                torch.testing.assert_close(tensor, tuned[name], atol=1e-6, rtol=0, msg=name)
        with pytest.raises(ValueError, match="its backbone is another one"):
            train(
                config,
                [f"out={tmp_path / 'other'}", f"training.start_from={best}", "model.backbone_args.stem=8"],
                progress=False,
            )

    def test_the_best_checkpoint_says_where_it_comes_from(self, config, tmp_path):
        run(config, tmp_path, "data.licence=CC0", "data.description=shapes")
        _, header = load_checkpoint(tmp_path / "tiny" / "best.safetensors")
        assert (header.licence, header.data, header.name) == ("CC0", "shapes", "tiny")
        assert {"f1", "precision", "recall", "threshold", "step"} <= set(header.metrics)
        assert header.postprocess["threshold"] == header.metrics["threshold"]
        run(config, tmp_path / "fixed", "postprocess.threshold=0.35")
        assert (
            load_checkpoint(tmp_path / "fixed" / "tiny" / "best.safetensors")[1].postprocess["threshold"]
            == 0.35
        )
        assert set(load_file(tmp_path / "tiny" / "best.safetensors"))
        rows = list(csv.DictReader(next((tmp_path / "tiny" / "csv").rglob("metrics.csv")).open()))
        assert any(row["val/f1"] for row in rows)
        assert list((tmp_path / "tiny" / "tensorboard").iterdir())

    def test_the_last_checkpoint_is_that_of_the_last_validation(self, config, tmp_path, monkeypatch):
        f1 = iter([0.5, 0.9, 0.1])
        scores = TrainingModule.validation_scores
        monkeypatch.setattr(
            TrainingModule, "validation_scores", lambda self: {**scores(self), "f1": next(f1)}
        )
        run(config, tmp_path, "training.steps=3", "training.validate_every=1")
        (best, of_best), (last, of_last) = (
            load_checkpoint(tmp_path / "tiny" / f"{name}.safetensors") for name in ("best", "last")
        )
        assert (of_best.metrics["step"], of_best.metrics["f1"]) == (2, 0.9)
        assert (of_last.metrics["step"], of_last.metrics["f1"]) == (3, 0.1)
        assert any(not torch.equal(a, b) for a, b in zip(best.parameters(), last.parameters(), strict=True))

    @pytest.mark.parametrize(
        "changes",
        [
            ["model.representation=1d", "model.upsample=0"],
            ["model.representation=eu", "model.upsample=2", "data.directed=false"],
            ["data.classes=[solid]", "training.precision=bf16-mixed"],
            ["training.ema_decay=0", "training.optimizer=adam", "training.workers=1"],
        ],
    )
    def test_every_kind_of_network_trains(self, config, tmp_path, changes, request):
        if "data.classes=[solid]" in changes:
            experiment = load_experiment(config)
            name = build_dataset(experiment.data.train[0], tmp_path, ()).classes[0]
            changes = [f"data.classes=[{name}]", *changes[1:]]
        run(config, tmp_path, "training.steps=2", *changes)


@pytest.mark.parametrize("name", list(REPRESENTATIONS))
def test_every_representation_overfits_four_images(name):
    torch.manual_seed(0)
    network = Network(
        backbone="residual",
        backbone_args={"widths": [16, 16, 32, 32], "blocks": [1, 1, 1, 1], "stem": 8},
        neck_width=32,
        predictors=2,
        representation=name,
    )
    rng = np.random.default_rng(0)
    samples = []
    for i in range(4):
        ends = rng.uniform(0, 1, (2, 2)) * [[96, 0], [96, 0]] + [[0, 0], [0, 64]]
        image = np.full((64, 96, 3), 60 * i, np.uint8)
        samples.append(Sample(str(i), image, Polylines.from_list([ends])))
    examples = Examples(
        [samples_of(samples)],
        None,
        Augment((64, 96)),
        Grid((64, 96), 16),
        border=network.representation.to_border,
    )
    batch = collate_examples([examples[i] for i in range(4)])
    criterion = Criterion(network.representation)
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    first = criterion(network(batch.images.float()), batch.targets)[0]
    for _ in range(300):
        losses, _ = criterion(network(batch.images.float()), batch.targets)
        optimizer.zero_grad()
        losses.total.backward()
        optimizer.step()
    assert losses.loc < 0.25 * first.loc
    assert losses.resp < 0.05
    assert losses.noresp < 0.03


def samples_of(samples):
    class Listed(list):
        classes = ("line",)
        directed = True

    return Listed(samples)


def test_the_schedule_warms_up_and_cools_down():
    def at(step):
        return learning_rate_factor(step, steps=100, warmup_steps=10, final=0.01)

    assert at(0) == pytest.approx(1 / 11)
    assert at(10) == pytest.approx(1)
    assert at(55) == pytest.approx(0.01 + 0.99 / 2)
    assert at(100) == pytest.approx(0.01)
    assert at(1000) == pytest.approx(0.01)


def test_no_epoch_and_no_process_repeats_examples():
    seen = []
    for epoch in range(3):
        for rank in range(2):
            seen += list(EndlessSampler(4, lambda place=(4 * epoch, rank, 2): place))
    assert sorted(seen) == list(range(24))


def test_an_example_depends_on_seed_and_number_alone(config, tmp_path):
    experiment = load_experiment(config, ["augment.preset=gentle"])
    one, two = (build_loaders(experiment, border=False)[0].dataset for _ in range(2))
    two[0]
    a, b = one[7], two[7]
    assert np.array_equal(a.image, b.image)
    assert np.array_equal(a.targets.endpoints, b.targets.endpoints)
    assert not np.array_equal(a.image, one[8].image)


def test_sources_are_drawn_by_weight(config, tmp_path):
    classes = ("line",)

    def source(value):
        found = samples_of([Sample("x", np.full((64, 96, 3), value, np.uint8), Polylines.from_list([]))])
        found.classes = classes
        return found

    examples = Examples(
        [source(10), source(200)], [3.0, 1.0], Augment((64, 96)), Grid((64, 96), 16), border=False
    )
    dark = np.mean([examples[i].image[0, 0, 0] == 10 for i in range(200)])
    assert 0.65 < dark < 0.85


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("data.train.0.dataset=cocoa", "use one of"),
        ("data.train.0.options.kinds=x", "takes no kinds"),
        ("data.classes=[purple]", "has no classes purple"),
        ("augment.preset=strong", "use one of"),
        (
            "augment.options.geometric.spin=3",
            r"'augment\.options\.geometric\.spin'; .*Allowed here: rotation",
        ),
        ("augment.options={geometric: {rotatoin_degrees: 3}}", r"did you mean 'rotation_degrees'\?"),
        ("augment.options.geometry.flip=1", r"did you mean 'geometric'\?"),
        ("augment.options.lines=3", "must hold keys and values"),
    ],
)
def test_mistakes_in_the_data_are_named_before_training(config, tmp_path, change, message):
    experiment = load_experiment(config, [change])
    with pytest.raises(ValueError, match=message):
        build_loaders(experiment, border=False)


@pytest.fixture
def described(tmp_path):
    """A dataset of files in two splits, with its description."""
    folder = tmp_path / "drawn"
    convert(Synthetic("shapes", length=3, size=(64, 96)), "geojson", folder)
    names = sorted(file.relative_to(folder).as_posix() for file in folder.glob("images/*.png"))
    (folder / "train.txt").write_text("\n".join(names[:2]))
    (folder / "val.txt").write_text(names[2])
    description = yaml.safe_load((folder / "data.yaml").read_text())
    description |= {
        "splits": {"train": "train.txt", "val": "val.txt"},
        "licence": "ours",
        "description": "drawn",
    }
    (folder / "data.yaml").write_text(yaml.safe_dump(description))
    return folder


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")
def test_a_described_dataset_trains_and_gives_its_licence(described, tmp_path):
    text = TEXT[: TEXT.index("  train:")] + f"  root: {tmp_path}\n  train: [{{data: drawn}}]\n"
    text += "  val: [{data: drawn/data.yaml}]\n" + TEXT[TEXT.index("model:") :]
    config = tmp_path / "described.yaml"
    config.write_text(text)
    train_loader, val_loader = build_loaders(load_experiment(config), border=False)
    assert (len(train_loader.dataset), len(val_loader.dataset)) == (2, 1)
    best = train(config, [f"out={tmp_path}", "training.steps=2"], progress=False)
    header = load_checkpoint(best)[1]
    assert (header.licence, header.data) == ("ours", "drawn")


def test_a_broken_label_stops_before_training_or_is_left_out(described, tmp_path, caplog):
    broken = sorted(described.glob("labels/**/*.geojson"))[0]
    broken.write_text("{")
    source = Source(data=described)
    with pytest.raises(ValueError, match=f"{broken.name}.* JSON"):
        build_dataset(source, tmp_path, ())
    assert len(build_dataset(source, tmp_path, (), skip_broken=True)) == 1
    assert "broken parts left out" in caplog.text


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ({}, "either data .* or dataset"),
        ({"data": "a", "dataset": "b"}, "either data .* or dataset"),
        ({"dataset": "b", "split": "val"}, "split needs data"),
    ],
)
def test_a_source_is_a_description_or_a_format(config, tmp_path, source, message):
    values = yaml.safe_load(TEXT)
    values["data"]["train"] = [source]
    config.write_text(yaml.safe_dump(values))
    with pytest.raises(ValueError, match=message):
        load_experiment(config)


def test_presets_can_be_changed_one_value_at_a_time(config):
    experiment = load_experiment(config, ["augment.preset=gentle", "augment.options.geometric.flip=0.0"])
    augment = build_augment(experiment.augment, (64, 96), "bottom")
    assert augment.geometric.flip == 0
    assert augment.geometric.rotation_degrees > 0


class TestFrozen:
    def test_frozen_parts_keep_weights_and_statistics_and_the_others_learn(self, config):
        experiment = load_experiment(config, ["training.freeze=[backbone.stem]"])
        module = TrainingModule(experiment)
        module.train()
        module.on_train_epoch_start()
        loader, _ = build_loaders(experiment, border=False)
        before = {name: tensor.clone() for name, tensor in module.network.state_dict().items()}
        optimizer = module.configure_optimizers()["optimizer"]
        for batch, _ in zip(loader, range(2), strict=False):
            loss, _ = module.criterion(module.network(batch.images.float()), batch.targets)
            loss.total.backward()
            optimizer.step()
        after = module.network.state_dict()
        same = {name for name in before if torch.equal(before[name], after[name])}
        assert {name for name in before if name.startswith("backbone.stem")} <= same
        assert "backbone.stages.0.0.first.1.running_mean" not in same
        assert "head.weight" not in same

    def test_a_misspelt_part_is_named(self, config):
        with pytest.raises(ValueError, match=r"'backbone\.stam'.*did you mean 'backbone\.stem'"):
            TrainingModule(load_experiment(config, ["training.freeze=[backbone.stam]"]))

    def test_the_backbone_learns_at_its_own_rate_and_vectors_do_not_decay(self, config):
        changes = ["training.lr=1e-3", "training.backbone_lr=0.1", "training.weight_decay=0.05"]
        module = TrainingModule(load_experiment(config, changes))
        groups = module.configure_optimizers()["optimizer"].param_groups
        found = {}
        for name, weights in module.network.named_parameters():
            (group,) = [g for g in groups if any(weights is p for p in g["params"])]
            found[name] = (group["initial_lr"], group["weight_decay"])
        assert found["backbone.stem.0.weight"] == (1e-4, 0.05)
        assert found["backbone.stem.1.weight"] == (1e-4, 0.0)
        assert found["head.weight"] == (1e-3, 0.05)
        assert found["head.bias"] == (1e-3, 0.0)
