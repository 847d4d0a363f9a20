import pytest
import yaml

from yolino.config import Experiment
from yolino.training.settings import FREE, SETTINGS, changed_settings, read_settings, with_defaults

SOURCE = {"dataset": "synthetic", "options": {"kind": "road"}}


@pytest.fixture
def settings():
    experiment = Experiment(name="a", data={"train": [SOURCE], "val": [SOURCE]})
    return experiment.model_dump(mode="json")


def test_settings_come_back_as_they_were_written(tmp_path, settings):
    (tmp_path / SETTINGS).write_text(yaml.safe_dump(settings))
    assert read_settings(tmp_path) == settings
    assert changed_settings(read_settings(tmp_path), settings) == []


def test_what_a_newer_version_added_is_no_change(tmp_path, settings):
    older = {key: value for key, value in settings.items() if key != "matching"}
    assert with_defaults(older, tmp_path) == settings


def test_only_what_makes_another_experiment_is_named(settings):
    now = settings | {
        "out": "elsewhere",
        "data": settings["data"] | {"licence": "ours", "cache": True},
        "training": settings["training"] | {"lr": 0.5, "workers": 7},
    }
    assert changed_settings(settings, now) == ["training.lr"]


def test_every_free_key_exists(settings):
    for key in FREE:
        *parents, last = key.split(".")
        at = settings
        for part in parents:
            at = at[part]
        assert last in at, key


def test_a_broken_file_is_one_sentence(tmp_path):
    (tmp_path / SETTINGS).write_text("name: [a\n")
    with pytest.raises(ValueError, match=r"experiment\.yaml is not YAML"):
        read_settings(tmp_path)
    (tmp_path / SETTINGS).write_text("name: a\ngone: 1\n")
    with pytest.raises(ValueError, match="another version of yolino"):
        read_settings(tmp_path)
