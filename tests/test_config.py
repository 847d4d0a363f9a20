"""The experiment file says what is wrong with it, and where."""

from pathlib import Path

import pytest

from yolino.config import differences, load_experiment

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
        ("data.scale=nan", r"data\.scale is nan: .*finite number"),
        ("data.scale=17", r"data\.scale is 17: a number above 0 and at most 16"),
        ("training.lr=.inf", r"training\.lr is inf: .*finite number"),
        ("training.seed=-1", r"training\.seed is -1: .*greater than or equal to 0"),
        ("training.seed=4294967296", r"training\.seed is 4294967296: .*less than 4294967296"),
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
    ("text", "message"),
    [
        ("- 1", "no sections"),
        ("a: [", "not YAML"),
        ("", "no sections"),
        ("name: a\nmodel: {predictors: 3}\nmodel: {upsample: 0}", "the key 'model' is there twice at line 3"),
        ("name: a\nmodel: {predictors: 3, predictors: 4}", "the key 'predictors' is there twice"),
        ("? [1]\n: 2", "not YAML: .*unhashable key"),
    ],
)
def test_what_is_no_experiment_file_says_so(file, text, message):
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        load_experiment(file)


def test_what_an_anchor_hands_on_may_be_replaced(file):
    file.write_text(TEXT + "loss: &loss {loc: 3, resp: 4}\naugment: {options: {<<: *loss, loc: 5}}")
    assert load_experiment(file).augment.options == {"loc": 5, "resp": 4}


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.yaml does not exist"):
        load_experiment(tmp_path / "nothing.yaml")


def test_every_committed_experiment_loads():
    files = sorted((Path(__file__).parents[1] / "configs").rglob("*.yaml"))
    assert files
    for path in files:
        head = path.read_text().splitlines()[0]
        assert head.startswith("#"), f"{path} does not say in its head what to expect"
        if path.name != "sweep.yaml":
            load_experiment(path)


def test_what_stands_in_quotation_marks_stays_a_text(file):
    assert load_experiment(file, ['name="1e3"']).name == "1e3"
    with pytest.raises(ValueError, match="is not a value in YAML"):
        load_experiment(file, ["training.lr=[1"])


class TestInheritance:
    @pytest.fixture
    def heir(self, file: Path) -> Path:
        (file.parent / "below").mkdir()
        return file.parent / "below" / "heir.yaml"

    def test_a_file_has_the_values_of_its_base_but_for_its_own(self, file, heir):
        heir.write_text(
            "base: ../trial.yaml\n"
            "data: {size: [64, 96], val: [{dataset: synthetic, options: {length: 5}}]}\n"
            "training: {steps: 7}\n"
        )
        experiment = load_experiment(heir, ["training.steps=8"])
        before = load_experiment(file)
        assert experiment.training.lr == 0.1
        assert experiment.training.steps == 8
        assert experiment.data.size == (64, 96)
        assert experiment.data.train == before.data.train
        assert [source.options for source in experiment.data.val] == [{"length": 5}]
        assert experiment.model == before.model

    def test_the_nearest_file_wins_and_null_takes_back(self, file, heir):
        middle = file.parent / "middle.yaml"
        middle.write_text("base: trial.yaml\ntraining: {lr: 0.2, steps: 3}\nmodel: {backbone_args: {a: 1}}\n")
        heir.write_text(
            "base: ../middle.yaml\ntraining: {steps: 4, lr: null}\nmodel: {backbone_args: null}\n"
        )
        experiment = load_experiment(heir)
        assert experiment.training.steps == 4
        assert experiment.training.lr == load_experiment(file, ["training={}"]).training.lr
        assert experiment.model.backbone_args == {}

    def test_it_is_called_like_its_file_or_as_it_says(self, heir):
        heir.write_text("base: ../trial.yaml")
        assert load_experiment(heir).name == "heir"
        heir.write_text("base: ../trial.yaml\nname: other")
        assert load_experiment(heir).name == "other"

    def test_lists_are_replaced_as_a_whole(self, file, heir):
        heir.write_text("base: ../trial.yaml\ndata: {train: [{dataset: culane}, {dataset: tusimple}]}")
        assert [source.dataset for source in load_experiment(heir).data.train] == ["culane", "tusimple"]

    @pytest.mark.parametrize(
        ("text", "error", "message"),
        [
            (
                "base: ../nothing.yaml",
                FileNotFoundError,
                r"heir\.yaml names the base .*nothing\.yaml, which does not",
            ),
            ("base: heir.yaml", ValueError, "cannot be its own base"),
            ("base: [../trial.yaml]", ValueError, "must be the path of one experiment file"),
            ("base: null", ValueError, "base is None"),
            ("base: ../trial.yaml\ntrainin: {steps: 1}", ValueError, "did you mean 'training'"),
        ],
    )
    def test_mistakes_are_told(self, heir, text, error, message):
        heir.write_text(text)
        with pytest.raises(error, match=message):
            load_experiment(heir)

    def test_a_circle_is_named(self, file, heir):
        heir.write_text("base: ../trial.yaml")
        file.write_text("base: below/heir.yaml")
        with pytest.raises(ValueError, match=r"heir\.yaml -> .*trial\.yaml -> .*heir\.yaml: an experiment"):
            load_experiment(heir)


def test_differences_name_the_keys():
    before = {"a": 1, "b": {"c": [1, 2], "d": None}, "e": {"f": 1}}
    assert differences(before, before) == []
    assert differences(before, {"a": 2, "b": {"c": [1], "d": None}, "e": 3, "g": 0}) == ["a", "b.c", "e", "g"]
