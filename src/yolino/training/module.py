"""The Lightning module: network, criterion, optimizer and schedule, and what validation measures."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn

from yolino.config import Experiment
from yolino.inference.flips import mirror_segments
from yolino.inference.rotations import join_views
from yolino.model.network import Network
from yolino.training.data import Batch, to_device
from yolino.training.losses import Criterion, Losses
from yolino.training.matching import several_at
from yolino.training.validation import THRESHOLDS, Validation
from yolino.types import Segments


def network_arguments(experiment: Experiment) -> dict[str, Any]:
    """Gives the arguments of `Network` that an experiment file describes."""
    return experiment.model.model_dump() | {"num_classes": len(experiment.data.classes)}


def learning_rate_factor(step: int, *, steps: int, warmup_steps: int, final: float) -> float:
    """Gives the share of the peak learning rate at a step: linear warm-up, then half a cosine to `final`."""
    if step < warmup_steps:
        return (step + 1) / (warmup_steps + 1)
    way = min((step - warmup_steps) / max(steps - warmup_steps, 1), 1.0)
    return final + (1 - final) * 0.5 * (1 + math.cos(math.pi * way))


def frozen_parts(network: Network, names: Sequence[str]) -> list[nn.Module]:
    """Gives the parts of a network with these names, whose weights will not be learned.

    Raises:
        ValueError: There is no part of a name.
    """
    parts = dict(network.named_modules())
    for name in names:
        if name not in parts:
            near = difflib.get_close_matches(name, list(parts), n=1)
            hint = f"; did you mean {near[0]!r}?" if near else "."
            raise ValueError(f"training.freeze names {name!r}, but the network has no such part{hint}")
        parts[name].requires_grad_(False)
    return [parts[name] for name in names]


def fuses(device: torch.device, precision: str) -> bool:
    """Tells whether one kernel updates all weights: on CUDA, and where no scaled gradients are clipped."""
    return device.type == "cuda" and precision != "16-mixed"


class TrainingModule(LightningModule):
    """Trains and validates one network.

    Args:
        experiment: The whole experiment file.
    """

    def __init__(self, experiment: Experiment) -> None:
        super().__init__()
        self.experiment = experiment
        network = Network(**network_arguments(experiment))
        self.network = network.to(memory_format=torch.channels_last)
        self.frozen = frozen_parts(self.network, experiment.training.freeze)
        self.criterion = Criterion(
            self.network.representation,
            directed=experiment.data.directed,
            spare=experiment.matching.spare,
            **experiment.loss.model_dump(),
        )
        self.validation = self._new_validation()
        # Validation sees other numbers of images, for each of which compiling would begin anew.
        compiling = experiment.training.compile
        self.compiled = torch.compile(self.network.forward) if compiling else None

    def on_train_epoch_start(self) -> None:
        """Keeps the statistics of the frozen parts, too, as they are."""
        for part in self.frozen:
            part.eval()

    def transfer_batch_to_device(self, batch: Batch, device: torch.device, dataloader_idx: int) -> Batch:
        """Moves the tensors; the polylines stay with the CPU's metrics."""
        return to_device(batch, device)

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Gives the loss of a batch."""
        prediction = (self.compiled or self.network)(batch.images.float())
        several = several_at(
            self.global_step,
            steps=self.experiment.training.steps,
            several=self.experiment.matching.several,
            until=self.experiment.matching.until,
        )
        losses, matches = self.criterion(prediction, batch.targets, several)
        self._log_losses("train", losses, len(batch.images))
        surplus = torch.full((), float(matches.surplus), device=self.device)  # a copy would wait for the GPU
        self.log("train/surplus", surplus, batch_size=len(batch.images))
        total: Tensor = losses.total
        return total

    def on_validation_epoch_start(self) -> None:
        """Begins new counts."""
        self.validation = self._new_validation()

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Scores segments and lines at each threshold; with `flip` those of both views."""
        images = batch.images.float()
        prediction = self.network(images)
        losses, _ = self.criterion(prediction, batch.targets)
        self._log_losses("val", losses, len(batch.images))
        every = self.segments(prediction, images.shape[-2:])
        if self.experiment.postprocess.flip:
            mirrored = self.segments(self.network(images.flip(-1)), images.shape[-2:])
            back = [mirror_segments(segments, images.shape[-1]) for segments in mirrored]
            every = [join_views(pair) for pair in zip(every, back, strict=True)]
        for i, segments in enumerate(every):
            self.validation.add(segments, batch.polylines[i], self.experiment.data.size, batch.ignore[i])

    def segments(self, prediction: Any, size: Sequence[int]) -> list[Segments]:
        """Gives the segments of each image above the lowest threshold, in pixels of the network's input."""
        outputs = self.network.decode(prediction, tuple(size))
        endpoints, scores, classes = (o.float().cpu().numpy().astype(np.float64) for o in outputs)
        found = []
        for i in range(len(scores)):
            kept = scores[i] >= THRESHOLDS[0]
            probabilities = classes[i][kept] if classes.shape[-1] else None
            found.append(Segments(endpoints[i][kept], scores[i][kept], probabilities=probabilities))
        return found

    def validation_scores(self) -> Mapping[str, float]:
        """Gives what `Validation.scores` says of the images since validation began."""
        return self.validation.scores()

    def _new_validation(self) -> Validation:
        experiment = self.experiment
        stride = float(self.network.stride)
        return Validation(experiment.postprocess, stride, directed=experiment.data.directed)

    def configure_optimizers(self) -> Any:
        """Gives Adam or AdamW with warm-up and cosine schedule."""
        training = self.experiment.training
        optimizer_class = torch.optim.AdamW if training.optimizer == "adamw" else torch.optim.Adam
        groups = self._parameter_groups()
        fused = fuses(self.device, training.precision)
        optimizer = optimizer_class(groups, lr=training.lr, fused=fused or None)
        schedule = torch.optim.lr_scheduler.LambdaLR(
            optimizer,
            lambda step: learning_rate_factor(
                step, steps=training.steps, warmup_steps=training.warmup_steps, final=training.final_lr
            ),
        )
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def configure_gradient_clipping(
        self,
        optimizer: torch.optim.Optimizer,
        gradient_clip_val: float | int | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clips the norm, as Lightning does, which refuses to with any fused optimizer in mixed precision.

        It fears that gradients are still scaled then, but bf16 scales none, and fp16 fuses none (`fuses`).
        """
        if gradient_clip_val:
            learned = (weights for group in optimizer.param_groups for weights in group["params"])
            nn.utils.clip_grad_norm_(learned, gradient_clip_val)

    def _parameter_groups(self) -> list[dict[str, Any]]:
        """Gives what is learned: the backbone at its own rate, vectors (biases, statistics) without decay."""
        training = self.experiment.training
        groups = []
        for backbone, decayed in itertools.product((True, False), repeat=2):
            chosen = [
                weights
                for name, weights in self.network.named_parameters()
                if weights.requires_grad
                and name.startswith("backbone.") == backbone
                and (weights.ndim > 1) == decayed
            ]
            decay = training.weight_decay if decayed else 0.0
            lr = training.lr * (training.backbone_lr if backbone else 1.0)
            groups.append({"params": chosen, "weight_decay": decay, "lr": lr})
        return [group for group in groups if group["params"]]

    def _log_losses(self, phase: str, losses: Losses, batch_size: int) -> None:
        values = {f"{phase}/{name}": value.detach() for name, value in losses._asdict().items()}
        self.log_dict(values, batch_size=batch_size, on_step=False, on_epoch=True, sync_dist=phase == "val")
