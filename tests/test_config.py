"""The experiment file says what is wrong with it, and where."""

from pathlib import Path

import pytest

from yolino.config import load_experiment

TEXT = """
name: trial
data:
  train: [{dataset: synthetic, options: {kind: shapes}}]
  val: [{dataset: synthetic}]
training: {lr: 0.1}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "trial.yaml"
    path.write_text(TEXT)
    return path


def test_values_defaults_and_overrides(file):
    experiment = load_experiment(
        file,
        [
            "training.lr=1e-3",
            "data.train.0.weight=2",
            "data.train.0.options.length=5",
            "loss.noresp=4",
            "data.size=[64, 96]",
        ],
    )
    assert experiment.training.lr == 1e-3
    assert experiment.data.train[0].weight == 2
    assert experiment.data.train[0].options == {"kind": "shapes", "length": 5}
    assert experiment.loss.noresp == 4
    assert experiment.data.size == (64, 96)
    assert experiment.model.predictors == 8


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "training.learning_rate=1",
            "unknown key 'training.learning_rate'.*Allowed here: freeze, start_from,",
        ),
        ("training.step=1", "did you mean 'steps'"),
        ("model.predictor=1", "did you mean 'predictors'"),
        ("data.train.0.datset=tusimple", "did you mean 'dataset'"),
        ("nam=x", "did you mean 'name'"),
        ("training.lr=-1", "training.lr is -1: .*greater than 0"),
        ("model.upsample=3", "model.upsample is 3"),
        ("data.train=[]", "data.train is"),
        ("data.fit=crop", "data.fit is 'crop'"),
        ("data.size=[48, 96]", r"data\.size is \[48, 96\]: height and width must be divisible by 32"),
        ("data.size=[0, 96]", r"data\.size is \[0, 96\]: .*divisible by 32"),
        ("data.scale=nan", r"data\.scale is nan: a number above 0 and at most 16"),
        ("data.scale=17", r"data\.scale is 17: a number above 0 and at most 16"),
        ("lr", "not of the form key=value"),
        ("data.train.7.weight=1", "7 must be a number from 0 to 0"),
        ("name.first=1", "name is a single value"),
    ],
)
def test_a_mistake_is_named_with_what_is_allowed(file, change, message):
    with pytest.raises(ValueError, match=message):
        load_experiment(file, [change])


def test_a_missing_key_is_named(file):
    file.write_text("name: x\ndata: {train: [{dataset: synthetic}]}")
    with pytest.raises(ValueError, match=r"'data\.val' is missing"):
        load_experiment(file)


@pytest.mark.parametrize(
    ("text", "message"), [("- 1", "no sections"), ("a: [", "not YAML"), ("", "no sections")]
)
def test_what_is_no_experiment_file_says_so(file, text, message):
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        load_experiment(file)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.yaml does not exist"):
        load_experiment(tmp_path / "nothing.yaml")


def test_every_committed_experiment_loads():
    files = sorted((Path(__file__).parents[1] / "configs").rglob("*.yaml"))
    assert files
    for path in files:
        head = path.read_text().splitlines()[0]
        assert head.startswith("#"), f"{path} does not say in its head what to expect"
        load_experiment(path)
