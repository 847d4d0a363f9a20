"""What makes a step fast on a GPU is tested on the CPU, and gives the same results."""

from __future__ import annotations

import copy
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch._subclasses.fake_tensor import (
    DataDependentOutputException,
    DynamicOutputShapeException,
    FakeTensorMode,
)

from yolino.config import load_experiment
from yolino.model.network import Prediction
from yolino.model.representations import REPRESENTATIONS
from yolino.training import checks
from yolino.training.callbacks import averaging
from yolino.training.checks import check_experiment, has_compiler
from yolino.training.confidence import CONFIDENCES
from yolino.training.data import to_device
from yolino.training.loaders import build_loaders, loader_options
from yolino.training.losses import Criterion
from yolino.training.matching import match
from yolino.training.module import TrainingModule, fuses
from yolino.training.targets import CellTargets, Targets, collate
from yolino.types import Polylines, Segments

CELLS, CLASSES = 6, 2


def labels(rng: np.random.Generator, images: int = 2) -> Targets:
    samples = []
    for _ in range(images):
        cells = np.repeat(np.arange(CELLS), rng.integers(0, 5, CELLS))
        ends = rng.random((len(cells), 2, 2), dtype=np.float32)
        samples.append(
            CellTargets(cells, ends, rng.integers(0, CLASSES, len(cells)), rng.random(CELLS) < 0.2)
        )
    return collate(samples)


def predicted(rng: np.random.Generator, name: str, targets: Targets) -> Prediction:
    shape = (len(targets.ignored), CELLS, 3)
    params = rng.normal(size=(*shape, REPRESENTATIONS[name].num_params)).astype(np.float32)
    return Prediction(
        REPRESENTATIONS[name]().activate(torch.from_numpy(params)).requires_grad_(),
        torch.rand(shape, requires_grad=True),
        torch.rand((*shape, CLASSES), requires_grad=True),
    )


OPTIONS: list[dict[str, Any]] = [{"several": 2}, {"direction": 1.0}, {"spare": 0.1, "several": 3}]
OPTIONS += [{"confidence": name, "direction": 1.0} for name in CONFIDENCES]


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize(
    ("name", "options"), [(name, {}) for name in REPRESENTATIONS] + [("po", options) for options in OPTIONS]
)
def test_matching_and_losses_never_wait_for_a_value(
    name: str, directed: bool, options: dict[str, Any]
) -> None:
    # Fake tensors have shapes and no values: whatever asks for one, as `.item()` or a mask does, raises. On a
    # GPU each such question stops the CPU until all is computed.
    targets = labels(np.random.default_rng(0))
    prediction = predicted(np.random.default_rng(1), name, targets)
    several = options.get("several", 1)
    named = {key: value for key, value in options.items() if key != "several"}
    criterion = Criterion(REPRESENTATIONS[name](), directed=directed, **named)
    mode = FakeTensorMode()

    def fake(value: Any) -> Any:
        return mode.from_tensor(value) if isinstance(value, torch.Tensor) else value

    leaves = Prediction(*(fake(value.detach()).requires_grad_() for value in prediction))
    unknown = Targets(*map(fake, targets))
    with mode:
        losses, matches = criterion(leaves, unknown, several)
        losses.total.backward()
    _, real = criterion(prediction, targets, several)
    assert matches.cells.shape == real.cells.shape
    assert matches.surplus == real.surplus


def test_a_question_for_a_value_would_be_noticed() -> None:
    mode = FakeTensorMode()
    mask = mode.from_tensor(torch.tensor([True, False]))
    for question in (lambda: mask[mask], lambda: mask.any().item(), lambda: torch.unique_consecutive(mask)):
        with mode, pytest.raises((DynamicOutputShapeException, DataDependentOutputException)):
            question()


def test_the_table_lists_the_segments_of_each_cell() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        targets = labels(rng)
        cells = sorted(set(targets.cells.tolist()))
        by_cell = {cell: [i for i, c in enumerate(targets.cells.tolist()) if c == cell] for cell in cells}
        assert [[i for i in row if i >= 0] for row in targets.table.tolist()] == list(by_cell.values())
        turns = [
            [row for row, cell in enumerate(cells) if len(by_cell[cell]) > rank]
            for rank in range(len(targets.counts))
        ]
        assert [part.tolist() for part in torch.split(targets.turns, list(targets.counts))] == turns


def test_the_average_equals_its_formula_tensor_by_tensor() -> None:
    generator = torch.Generator().manual_seed(0)
    weights = [torch.randn(shape, generator=generator) for shape in ((3, 4), (5,), ())]
    averages = [torch.randn(w.shape, generator=generator) for w in weights]
    decay = 0.9
    for count in (1, 2, 50, 5000):
        now = min(decay, (1 + count) / (10 + count))
        expected = [now * a + (1 - now) * w for a, w in zip(averages, weights, strict=True)]
        averaging(decay)(averages, weights, torch.tensor(count))
        for a, b in zip(averages, expected, strict=True):
            assert torch.equal(a, b)
    batches = [torch.tensor(40)]
    averaging(0.5)(batches, [torch.tensor(60)], torch.tensor(100))
    assert batches[0].item() == 50


@pytest.fixture
def experiment(tmp_path: Path) -> Any:
    config = tmp_path / "tiny.yaml"
    source = "{dataset: synthetic, options: {kind: shapes, length: 4, size: [64, 96]}}"
    config.write_text(
        f"name: tiny\nout: {tmp_path}\ndata: {{size: [64, 96], train: [{source}], val: [{source}]}}\n"
        "model: {backbone: residual, neck_width: 8, predictors: 2,\n"
        "  backbone_args: {widths: [8, 8, 8, 8], blocks: [1, 1, 1, 1], stem: 4}}\n"
        "training: {batch_size: 2, validate_every: 2, accelerator: cpu}\n"
    )
    return lambda *changes: load_experiment(config, changes)


def test_gradients_are_clipped_with_a_fused_optimizer_as_with_any(experiment: Any) -> None:
    module = TrainingModule(experiment())
    other = copy.deepcopy(module.network)
    for network in (module.network, other):
        for weights in network.parameters():
            weights.grad = torch.full_like(weights, 3.0)
    optimizer = torch.optim.AdamW(module.network.parameters(), fused=True)
    module.configure_gradient_clipping(optimizer, 10.0, "norm")
    torch.nn.utils.clip_grad_norm_(other.parameters(), 10.0)
    for a, b in zip(module.network.parameters(), other.parameters(), strict=True):
        assert a.grad is not None
        assert b.grad is not None
        assert torch.equal(a.grad, b.grad)
    assert fuses(torch.device("cuda"), "bf16-mixed")
    assert not fuses(torch.device("cuda"), "16-mixed")
    assert not fuses(torch.device("cpu"), "bf16-mixed")


def test_batches_for_a_gpu_are_uint8_pinned_and_channels_last(experiment: Any) -> None:
    assert loader_options(2, cuda=True)["pin_memory"]
    assert not loader_options(2, cuda=False)["pin_memory"]
    loader, _ = build_loaders(experiment(), border=False)
    batch = to_device(next(iter(loader)), torch.device("cpu"))
    assert batch.images.dtype == torch.uint8
    assert batch.images.is_contiguous(memory_format=torch.channels_last)
    meta = to_device(batch, torch.device("meta"))
    assert {t.device.type for t in (meta.images, meta.targets.cells, meta.targets.turns)} == {"meta"}
    assert meta.targets.counts == batch.targets.counts


def test_compiling_needs_a_compiler(experiment: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks.shutil, "which", lambda name: None)
    with pytest.raises(ValueError, match=r"training\.compile needs a C\+\+ compiler"):
        check_experiment(experiment("training.compile=true"))
    check_experiment(experiment())


@pytest.mark.skipif(not has_compiler(), reason="torch.compile needs a C++ compiler, and there is none")
@pytest.mark.skipif("YOLINO_COMPILE" not in os.environ, reason="takes minutes, set YOLINO_COMPILE=1")
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")
def test_a_compiled_network_gives_the_same_loss_and_the_same_checkpoint(experiment: Any) -> None:
    plain, compiled = TrainingModule(experiment()), TrainingModule(experiment("training.compile=true"))
    compiled.load_state_dict(plain.state_dict())
    assert list(plain.state_dict()) == list(compiled.state_dict())
    batch = next(iter(build_loaders(experiment(), border=False)[0]))
    losses = []
    for module in (plain, compiled):
        module.log = module.log_dict = lambda *_, **__: None
        loss = module.training_step(batch, 0)
        loss.backward()
        losses.append((loss, [w.grad for w in module.network.parameters()]))
    torch.testing.assert_close(losses[0], losses[1], rtol=1e-3, atol=1e-4)


def test_matching_takes_its_numbers_from_the_labels_alone() -> None:
    targets = labels(np.random.default_rng(2))
    params = torch.rand(2, CELLS, 3, 4)
    found = match(params, targets, REPRESENTATIONS["po"]())
    assert len(found.targets) == sum(targets.counts[:3])


def test_the_step_decides_how_many_predictors_answer(
    experiment: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes = ("training.steps=8", "matching.several=2", "matching.until=0.5", "matching.spare=0.1")
    module = TrainingModule(experiment(*changes, "loss.confidence=quality", "loss.direction=0.5"))
    assert (module.criterion.spare, module.criterion.direction) == (0.1, 0.5)
    assert module.criterion.confidence is CONFIDENCES["quality"]
    asked: list[int] = []
    criterion = module.criterion.forward
    monkeypatch.setattr(module.criterion, "forward", lambda *a: (asked.append((*a, 1)[2]), criterion(*a))[1])
    monkeypatch.setattr(module, "log", lambda *_, **__: None)
    monkeypatch.setattr(module, "log_dict", lambda *_, **__: None)
    batch = next(iter(build_loaders(experiment(), border=False)[0]))
    for step in (0, 3, 4, 7):
        monkeypatch.setattr(TrainingModule, "global_step", step)
        assert torch.isfinite(module.training_step(batch, 0))
    module.on_validation_epoch_start()
    monkeypatch.setattr(TrainingModule, "global_step", 0)
    with torch.no_grad():
        module.validation_step(batch, 0)
    assert asked == [2, 2, 1, 1, 1]


@pytest.mark.parametrize(("flip", "recall"), [(False, 0.5), (True, 1.0)])
def test_validation_sees_the_mirrored_image_where_a_predictor_does(
    experiment: Any, monkeypatch: pytest.MonkeyPatch, flip: bool, recall: float
) -> None:
    module = TrainingModule(experiment(f"postprocess.flip={str(flip).lower()}"))
    monkeypatch.setattr(module, "log_dict", lambda *_, **__: None)
    batch = next(iter(build_loaders(experiment(), border=False)[1]))
    left = [[10.0, 60.0], [10.0, 4.0]]
    lines = Polylines.from_list([np.array(left), 96 - np.array([[10.0, 36.0], [10.0, 92.0]])])
    one = Segments([left], [0.9])
    monkeypatch.setattr(module, "segments", lambda prediction, size: [one] * len(prediction.confidence))
    module.on_validation_epoch_start()
    with torch.no_grad():
        module.validation_step(batch._replace(polylines=(lines,) * len(batch.images)), 0)
    scores = module.validation_scores()
    assert (scores["recall"], scores["precision"]) == (recall, 1.0)


def test_an_unknown_confidence_stops_before_training(experiment: Any) -> None:
    with pytest.raises(ValueError, match=r"^loss\.confidence 'qualiti' is unknown; did you mean 'quality'\?"):
        TrainingModule(experiment("loss.confidence=qualiti"))
