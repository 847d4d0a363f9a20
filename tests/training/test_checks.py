"""What the model file would carry is checked before the first step."""

from pathlib import Path

import pytest

from yolino.config import load_experiment
from yolino.training.checks import check_experiment
from yolino.training.run import train

TEXT = """
name: tiny
data:
  size: [64, 96]
  train: [{dataset: synthetic, options: {kind: shapes, length: 50, size: [64, 96]}}]
  val: [{dataset: synthetic, options: {kind: shapes, length: 3, seed: 9, size: [64, 96]}}]
model: {backbone: residual}
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.yaml"
    path.write_text(TEXT)
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            ["postprocess.linker=grph"],
            r"^postprocess\.linker 'grph' is unknown; did you mean 'graph'\? Known",
        ),
        (["postprocess.nms.epsilom=1"], r"'postprocess\.nms\.epsilom'; did you mean 'epsilon'\?"),
        (["postprocess.nms.cell_size=1"], r"unknown key 'postprocess\.nms\.cell_size'"),
        (["postprocess.nms.epsilon=-1.0"], r"^postprocess\.nms: epsilon is -1"),
        (["postprocess.linker_options.min_scor=0.1"], r"did you mean 'min_score'\?"),
        (["postprocess.linker_options.link_radius_cells=-1.0"], r"^postprocess\.linker_options: link_radius"),
        (["postprocess.rotations=2"], r"^postprocess\.rotations: .*only windows"),
        (["postprocess.rotations=4", "data.fit=window"], r"^postprocess\.rotations: .*no squares"),
        (["data.scale=0.5"], 'only the fit "window" has a scale'),
        (["model.backbone_args.pretrained=true"], r"give model\.pretrained instead"),
    ],
)
def test_what_the_model_could_not_be_used_with_is_refused(config, changes, message):
    with pytest.raises(ValueError, match=message):
        check_experiment(load_experiment(config, changes))


def test_what_fits_gives_the_header_that_will_be_written(config):
    changes = ["postprocess.linker=chain", "postprocess.nms.epsilon=0.03", "postprocess.threshold=0.4"]
    header = check_experiment(load_experiment(config, changes))
    assert header.postprocess["linker"] == "chain"
    assert header.postprocess["threshold"] == 0.4
    assert (header.size, header.stride) == ((64, 96), 16)


def test_training_checks_before_it_writes_anything(config, tmp_path):
    with pytest.raises(ValueError, match=r"did you mean 'graph'"):
        train(config, [f"out={tmp_path / 'out'}", "postprocess.linker=grph"], progress=False)
    assert not (tmp_path / "out").exists()
