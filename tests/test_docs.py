"""The documentation says what is true: names exist, links lead somewhere, commands and examples work."""

from __future__ import annotations

import importlib
import importlib.util
import re
import shlex
import shutil
import tomllib
from pathlib import Path
from typing import Any

import click
import pytest
import typer
import yaml
from pydantic import BaseModel

from yolino.cli import app
from yolino.config import Experiment
from yolino.datasets.description import Description, build
from yolino.datasets.detection import detect_format
from yolino.io import from_json
from yolino.types import Polylines

ROOT = Path(__file__).parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
TORCH_ROOMS = ("yolino.model", "yolino.training", "yolino.export")
MODEL = ROOT / "src" / "yolino" / "models" / "default.onnx"
EXAMPLE = ROOT / "examples" / "highway.jpg"


def _id(value: object) -> str | None:
    return value.relative_to(ROOT).as_posix() if isinstance(value, Path) else None


def _blocks(page: Path, language: str) -> list[str]:
    """Gives the fenced blocks of a language."""
    return re.findall(
        rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


def _prose(page: Path) -> str:
    """Gives the page without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def _names() -> list[tuple[Path, str]]:
    pattern = re.compile(r"`(yolino(?:\.[A-Za-z_]\w*)+)[`(]")
    return sorted({(page, name) for page in PAGES for name in pattern.findall(_prose(page))})


def _resolve(name: str) -> object:
    """Gives what a dotted name stands for; a field that exists on instances alone gives its annotation.

    Raises:
        AttributeError: There is no such thing.
    """
    parts = name.split(".")
    value: Any = importlib.import_module(parts[0])
    for depth, part in enumerate(parts[1:], 2):
        module = ".".join(parts[:depth])
        if not hasattr(value, part) and hasattr(value, "__path__") and importlib.util.find_spec(module):
            importlib.import_module(module)
        annotations = getattr(value, "__annotations__", {}) if isinstance(value, type) else {}
        value = annotations[part] if part in annotations else getattr(value, part)
    return value


@pytest.mark.parametrize(("page", "name"), _names(), ids=_id)
def test_every_name_in_the_documentation_exists(page: Path, name: str) -> None:
    if name.startswith(TORCH_ROOMS) and importlib.util.find_spec("torch") is None:
        pytest.skip("torch is not installed")
    _resolve(name)


def test_a_name_that_does_not_exist_is_noticed() -> None:
    with pytest.raises(AttributeError):
        _resolve("yolino.types.Segments.middle")
    with pytest.raises(AttributeError):
        _resolve("yolino.typos")


def _anchors(page: Path) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", _prose(page), re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", title).strip().lower() for title in titles]
    return {re.sub(r"[ \-]+", "-", title) for title in plain}


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", _prose(page)):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{target} does not exist"
        assert not anchor or anchor in _anchors(file), f"{target} names no heading of {file.name}"


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_every_path_of_the_repository_exists(page: Path) -> None:
    for path in re.findall(r"`((?:src|tests|configs|docs|examples|\.ci)/[\w./-]*)`", _prose(page)):
        assert (ROOT / path).exists(), f"{path} does not exist"


def test_every_page_is_in_the_navigation() -> None:
    def files(entry: Any) -> set[str]:
        if isinstance(entry, str):
            return {entry}
        return {
            file for part in (entry.values() if isinstance(entry, dict) else entry) for file in files(part)
        }

    navigation = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    assert files(navigation) == {page.relative_to(ROOT / "docs").as_posix() for page in PAGES[3:]}


def _commands() -> list[tuple[Path, str]]:
    found = []
    for page in PAGES:
        lines = [line for block in _blocks(page, "console") for line in block.splitlines()]
        inline = re.findall(r"`(yolino [a-z][^`]*)`", _prose(page))
        for line in [*lines, *inline]:
            found += [(page, part.strip()) for part in line.split("&&") if part.strip().startswith("yolino ")]
    return sorted(set(found))


@pytest.mark.parametrize(("page", "command"), _commands(), ids=_id)
def test_every_command_in_the_documentation_exists(page: Path, command: str) -> None:
    at: click.Command = typer.main.get_command(app)
    words = shlex.split(command)[1:]
    while words and isinstance(getattr(at, "commands", None), dict):
        names = at.commands  # type: ignore[attr-defined]
        assert words[0].rstrip(",") in names, f"yolino has no command {words[0]}"
        at = names[words.pop(0).rstrip(",")]
    options = {option for parameter in at.params for option in (*parameter.opts, *parameter.secondary_opts)}
    for word in words:
        if word.startswith("-"):
            assert word.partition("=")[0] in options, f"{at.name} has no option {word}"


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_every_experiment_in_the_documentation_is_valid(page: Path) -> None:
    for block in _blocks(page, "yaml"):
        values = yaml.safe_load(block)
        if "data" in values:
            Experiment.model_validate(values)


def _keys(model: type[BaseModel], prefix: str = "") -> set[str]:
    found = set()
    for name, info in model.model_fields.items():
        found.add(prefix + name)
        if isinstance(info.annotation, type) and issubclass(info.annotation, BaseModel):
            found |= _keys(info.annotation, f"{prefix}{name}.")
    return found


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_every_key_of_an_experiment_exists(page: Path) -> None:
    keys = _keys(Experiment)
    sections = "|".join(Experiment.model_fields)
    named = re.findall(rf"`((?:{sections})\.[a-z_]+(?:\.[a-z_]+)*)(?:=[^`]*)?`", _prose(page))
    for key in set(named) - {"data.yaml", "data.yml"}:
        assert key in keys, f"an experiment has no key {key}"


def _pages_with_examples() -> list[Path]:
    return [page for page in PAGES if _blocks(page, "python")]


@pytest.mark.parametrize("page", _pages_with_examples(), ids=_id)
def test_the_examples_in_python_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = "\n".join(_blocks(page, "python"))
    if "yolino.load" in code:
        if not (MODEL.is_file() and EXAMPLE.is_file()):
            pytest.skip("the packaged model or the example picture is not there")
        (tmp_path / "examples").mkdir()
        shutil.copy(EXAMPLE, tmp_path / "examples")
        shutil.copy(MODEL, tmp_path / "lanes.onnx")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, page.name, "exec"), {"__name__": page.stem})


def test_the_example_of_a_dataset_reads_what_it_says(tmp_path: Path) -> None:
    scope: dict[str, Any] = {"__name__": "example"}
    exec(compile(_blocks(ROOT / "CONTRIBUTING.md", "python")[0], "CONTRIBUTING.md", "exec"), scope)
    (tmp_path / "a.jpg").touch()
    (tmp_path / "a.txt").write_text("1 2 3 4.5\n0 0 8 8 9 7\n")
    dataset = scope["TextLines"](tmp_path)
    polylines = dataset[0].polylines
    assert len(dataset) == 1
    assert isinstance(polylines, Polylines)
    assert polylines.offsets.tolist() == [0, 2, 5]
    assert polylines.vertices[1].tolist() == [3, 4.5]


def test_the_json_in_the_documentation_is_a_result() -> None:
    result = from_json(_blocks(ROOT / "docs" / "inference.md", "json")[0])
    assert result.size == (720, 1280)
    assert len(result.polylines) == 1


def test_a_description_in_the_documentation_is_valid() -> None:
    for page in (ROOT / "README.md", ROOT / "docs" / "datasets.md"):
        (block,) = [block for block in _blocks(page, "yaml") if block.startswith("format:")]
        Description.model_validate(yaml.safe_load(block))


EXAMPLES = {
    "TuSimple": ("tusimple", "label_data_1.json"),
    "CurveLanes": ("curvelanes", "labels/ab.lines.json"),
    "GeoJSON": ("geojson", "labels/a.geojson"),
    "CVAT": ("cvat", "annotations.xml"),
    "LabelMe": ("labelme", "a.json"),
    "Label Studio": ("labelstudio", "project.json"),
    "COCO with polylines": ("coco", "annotations/train.json"),
    "Results": ("results", "a.json"),
}


@pytest.mark.parametrize("title", EXAMPLES)
def test_the_examples_of_formats_are_read(title: str, tmp_path: Path) -> None:
    format, file = EXAMPLES[title]
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    section = re.split(r"^## ", text, flags=re.MULTILINE)
    (mine,) = [part for part in section if part.startswith(f"{title}\n")]
    (example,) = re.findall(r"^```(?:json|xml)\n(.*?)^```", mine, re.MULTILINE | re.DOTALL)
    path = tmp_path / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(example)
    assert detect_format(tmp_path) == format
    dataset = build(format, {"root": tmp_path, "require_images": False})
    assert len(dataset) == 1
    assert len(dataset[0].polylines) >= 1


def _marked_command(marker: str) -> str:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.findall(rf"<!-- {marker} -->\n```console\n(.*)\n```\n", text)
    assert len(found) == 1, f"README.md must have one command of one line after {marker}"
    return str(found[0])


def test_the_two_commands_of_the_readme_are_marked_for_ci() -> None:
    assert _marked_command("predict-command").endswith(
        f"yolino predict {EXAMPLE.relative_to(ROOT).as_posix()}"
    )
    test = _marked_command("test-command")
    assert test.endswith("pytest -q")
    extras = re.search(r'"\.\[(.*)\]"', test)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert extras is not None
    assert set(extras[1].split(",")) <= set(project["optional-dependencies"])


def test_the_version_of_the_citation_is_that_of_the_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == project["version"]
