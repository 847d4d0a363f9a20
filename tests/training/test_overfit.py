"""Each option of loss and matching learns a tiny set by heart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from yolino.grid import Grid
from yolino.model.network import Prediction
from yolino.model.representations import CartesianPoints
from yolino.training.confidence import CONFIDENCES
from yolino.training.losses import Criterion
from yolino.training.matching import several_at
from yolino.training.targets import cell_targets, collate
from yolino.types import Polylines

STEPS, PREDICTORS = 160, 4
OPTIONS: dict[str, dict[str, Any]] = {name: {"confidence": name} for name in CONFIDENCES}
OPTIONS |= {
    "direction": {"direction": 2.0},
    "spare": {"spare": 0.1},
    "undirected": {"directed": False, "direction": 2.0},
    "several": {"several": 3},
    "all": {"several": 3, "confidence": "quality", "direction": 2.0, "spare": 0.05},
}


class Tiny(nn.Module):
    """A linear network that sees which image and which cell it is, and answers as the real one does."""

    def __init__(self, images: int, cells: int) -> None:
        super().__init__()
        self.seen = nn.Parameter(torch.randn(images, cells, 16))
        self.head = nn.Linear(16, PREDICTORS * 5)
        with torch.no_grad():
            self.head.bias.copy_(torch.randn(PREDICTORS, 5).index_fill_(1, torch.tensor(4), -3.0).flatten())

    def forward(self) -> Prediction:
        raw: Tensor = self.head(self.seen).unflatten(-1, (PREDICTORS, 5))
        params = CartesianPoints().activate(raw[..., :4])
        return Prediction(params, raw[..., 4].sigmoid(), raw[..., 5:])


@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_every_option_overfits_two_images(options: dict[str, Any]) -> None:
    several = options.get("several", 1)
    named = {key: value for key, value in options.items() if key != "several"}
    torch.manual_seed(0)
    rng, grid = np.random.default_rng(0), Grid((64, 96), 16)
    images = [
        Polylines.from_list([rng.uniform(0, 1, (2, 2)) * [96, 0] + [[0, 0], [0, 64]] for _ in range(2)])
        for _ in range(2)
    ]
    targets = collate([cell_targets(lines, grid, border=False) for lines in images])
    network = Tiny(2, grid.rows * grid.cols)
    criterion = Criterion(CartesianPoints(), **named)
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-2)
    first = criterion(network(), targets)[0]
    for step in range(STEPS):
        losses, _ = criterion(network(), targets, several_at(step, steps=STEPS, several=several, until=0.25))
        optimizer.zero_grad()
        losses.total.backward()
        optimizer.step()
    losses, matches = criterion(network(), targets)
    assert losses.loc < 0.15 * first.loc
    assert losses.resp < 0.05
    assert losses.noresp < 0.03
    assert losses.direction < 0.02
    # What the scores are for: the responsible predictors are told from the rest of the cells.
    confidence = network().confidence.flatten(0, 1)
    answers = confidence[matches.cells, matches.predictors]
    empty = torch.ones(len(confidence), dtype=torch.bool)
    empty[targets.cells] = False
    assert answers.median() > 0.5
    assert confidence[empty].max() < 0.5 * answers.median()
