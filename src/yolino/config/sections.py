"""The sections of an experiment file; their keys are the constructors' arguments."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator


class Section(BaseModel):
    """A part of the experiment file; a key that it does not know is a mistake, and so is NaN or infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=(), allow_inf_nan=False)


class Source(Section):
    """One dataset to draw samples from: a description (`data`), or a format and its arguments.

    Attributes:
        data: A `data.yaml` or the folder of a dataset; a relative path that does not exist lies below the
            `root` of the data section.
        split: Split of `data`; without one `train` in training and `val` in validation.
        dataset: Name in `DATASETS`, instead of `data`.
        weight: Share of the samples drawn from it in training, relative to the other sources.
        options: Arguments of the dataset; a relative `root` lies below the `root` of the data section.
    """

    data: Path | None = None
    split: str | None = None
    dataset: str | None = None
    weight: float = Field(1.0, gt=0)
    options: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_one(self) -> Source:
        if (self.data is None) == (self.dataset is None):
            raise ValueError("a source needs either data (a data.yaml or folder) or dataset (a format)")
        if self.split is not None and self.data is None:
            raise ValueError("split needs data: a format alone has no splits, use options.labels")
        return self


class Data(Section):
    """What to train and validate on.

    Attributes:
        train: Sources of the training samples.
        val: Sources of the validation samples.
        root: Folder that holds the datasets.
        size: Input of the network in pixels, (height, width), divisible by 32.
        fit: How an image is fitted to the input; `window` does not fit it: training draws windows of `size`
            anywhere in it, and the model goes over an image of any size in windows.
        scale: Pixels of the network's input per pixel of the image, for the fit `window`.
        cache: Whether files are decoded, and scenes drawn, once, into `decoded` below `out`; always so for
            the fit `window`.
        classes: Names of the classes to predict; empty for a network without classes.
        directed: Whether the direction of a line means something.
        licence: Licence of the training data; written into every model file.
        description: What the data is, for the model file.
    """

    train: tuple[Source, ...] = Field(min_length=1)
    val: tuple[Source, ...] = Field(min_length=1)
    root: Path = Path("data")
    size: tuple[int, int] = (320, 640)
    fit: Literal["bottom", "stretch", "letterbox", "window"] = "bottom"
    scale: float = 1.0
    cache: bool = False
    classes: tuple[str, ...] = ()
    directed: bool = True
    licence: str = "unknown"
    description: str = "unknown"

    @field_validator("size", "scale")
    @classmethod
    def _check_range(cls, value: Any) -> Any:
        if isinstance(value, tuple) and any(edge < 32 or edge % 32 for edge in value):
            raise ValueError("height and width must be divisible by 32, such as [320, 640]")
        if isinstance(value, float) and not 0 < value <= 16:
            raise ValueError("a number above 0 and at most 16 is needed")
        return value


class Model(Section):
    """Arguments of `yolino.model.network.Network`."""

    backbone: str = "darknet19"
    backbone_args: dict[str, Any] = Field(default_factory=dict)
    pretrained: bool = False
    upsample: Literal[0, 1, 2] = 1
    neck: str = "upsampling"
    neck_width: int = Field(448, ge=2)
    predictors: int = Field(8, ge=1)
    representation: str = "po"


class Loss(Section):
    """Weights of the four loss terms (paper, Eq. 4-7), and what may be added to them.

    Attributes:
        loc: Weight of the localization.
        resp: Weight of the responsible predictors' confidence.
        noresp: Weight of the free predictors' confidence.
        classes: Weight of the classification.
        direction: Weight of 1 - cosine of the angle to the true direction.
        confidence: Name in `CONFIDENCES`: what the confidence of the predictors is compared with, and how.
    """

    loc: float = Field(2.0, ge=0)
    resp: float = Field(1.0, ge=0)
    noresp: float = Field(1.0, ge=0)
    classes: float = Field(1.0, ge=0)
    direction: float = Field(0.0, ge=0)
    confidence: str = "squared"


class Matching(Section):
    """Which predictors answer for a true segment.

    Attributes:
        several: Predictors that answer for each segment at the beginning; 1 is the paper's matching.
        until: Share of the steps after which one answers for each.
        spare: Free predictors nearer than this to a true segment, in cells, are not punished.
    """

    several: int = Field(1, ge=1)
    until: float = Field(0.5, ge=0, le=1)
    spare: float = Field(0.0, ge=0)


class Augmentation(Section):
    """A named preset of `yolino.training.augment.PRESETS` and what to change in it."""

    preset: str = "gentle"
    options: dict[str, Any] = Field(default_factory=dict)


class Training(Section):
    """How to optimize.

    Attributes:
        freeze: Parts of the network that keep their weights and statistics, such as `backbone.conv_stem`.
        start_from: Checkpoint whose weights training begins with (fine-tuning); none for random weights.
        steps: Optimizer steps in all.
        batch_size: Images per step (and process).
        lr: Peak learning rate, reached after the warm-up, then lowered by half a cosine.
        backbone_lr: Learning rate of the backbone as a share of `lr`: small where its weights are pretrained.
        weight_decay: Decay rate.
        optimizer: `adamw`, or `adam` as in the paper.
        warmup_steps: Steps of linear warm-up.
        final_lr: Learning rate at the end, as a share of `lr`.
        clip: Largest gradient norm.
        precision: Lightning's precision: `32-true`, `bf16-mixed`, `16-mixed`.
        compile: Whether `torch.compile` makes kernels for the network.
        ema_decay: Decay of the exponential moving average of the weights; 0 trains without.
        validate_every: Steps between two validations and checkpoints; the last step is always validated.
        patience: Validations without a better F1 after which training stops early; 0 never stops early.
        workers: Processes that load data.
        seed: Seed of everything random, of 32 bits.
        accelerator: Lightning's accelerator.
        devices: Lightning's devices.
        threads: Threads of the CPU for the network; 0 leaves torch's choice.
    """

    freeze: tuple[str, ...] = ()
    start_from: Path | None = None
    steps: int = Field(5000, ge=1)
    batch_size: int = Field(8, ge=1)
    lr: float = Field(2e-3, gt=0)
    backbone_lr: float = Field(1.0, ge=0)
    weight_decay: float = Field(1e-4, ge=0)
    optimizer: Literal["adam", "adamw"] = "adamw"
    warmup_steps: int = Field(100, ge=0)
    final_lr: float = Field(0.01, ge=0, le=1)
    clip: float = Field(10.0, gt=0)
    precision: Literal["32-true", "bf16-mixed", "16-mixed"] = "32-true"
    compile: bool = False
    ema_decay: float = Field(0.998, ge=0, lt=1)
    validate_every: int = Field(250, ge=1)
    patience: int = Field(0, ge=0)
    workers: int = Field(0, ge=0)
    seed: int = Field(0, ge=0, lt=2**32)
    accelerator: str = "auto"
    devices: str | int = "auto"
    threads: int = Field(0, ge=0)


class Postprocess(Section):
    """Threshold, NMS and linker that the trained model carries.

    Attributes:
        threshold: Smallest score of a segment; none takes the one with the best F1 in validation.
        nms: Arguments of `NMS`.
        flip: Whether the network also sees the mirrored image, for fits other than `window`. It takes twice
            as long, and finds a little more.
        rotations: For the fit `window`: how many views of a window the network sees, turned by a half (2) or
            by quarters (4). It takes as many times longer, and finds a little more.
        linker: Name in `LINKERS`.
        linker_options: Arguments of the linker.
    """

    threshold: float | None = Field(None, ge=0, le=1)
    nms: dict[str, Any] = Field(default_factory=dict)
    flip: bool = False
    rotations: Literal[1, 2, 4] = 1
    linker: str = "graph"
    linker_options: dict[str, Any] = Field(default_factory=dict)


class Experiment(Section):
    """The whole experiment file.

    Attributes:
        name: Name of the model and of its folder of results.
        out: Folder that holds the results of all experiments.
    """

    name: str = Field(min_length=1)
    data: Data
    model: Model = Model()
    loss: Loss = Loss()
    matching: Matching = Matching()
    augment: Augmentation = Augmentation()
    training: Training = Training()
    postprocess: Postprocess = Postprocess()
    out: Path = Path("runs")


__all__ = [
    "Augmentation",
    "Data",
    "Experiment",
    "Loss",
    "Matching",
    "Model",
    "Postprocess",
    "Section",
    "Source",
    "Training",
]
