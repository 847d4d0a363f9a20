from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.mask_pixels import mask_to_polygons
from yolino.datasets.masks import Masks, MasksWriter
from yolino.geometry import distance_to_segments
from yolino.types import Polylines, Sample

pytest.importorskip("skimage", reason="scikit-image traces the masks of these tests")

SIZE = (60, 80)


def blank(value: int = 0) -> np.ndarray:
    return np.full(SIZE, value, np.uint8)


def stroke(*rows: int, value: int = 255) -> np.ndarray:
    """A mask with a level line in each row, in the columns 10 to 69."""
    mask = blank()
    mask[list(rows), 10:70] = value
    return mask


def save(path: Path, pixels: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels)
    return path


def photo(path: Path, size: tuple[int, int] = SIZE) -> Path:
    return save(path, np.full((*size, 3), 90, np.uint8))


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [line.tolist() for line in polylines]


def level(row: int) -> list[list[float]]:
    return [[10.5, row + 0.5], [69.5, row + 0.5]]


def test_a_folder_of_masks_becomes_samples(tmp_path):
    photo(tmp_path / "a.jpg")
    photo(tmp_path / "images/b.png")
    save(tmp_path / "masks/a.png", stroke(20, 40))
    save(tmp_path / "masks/b.png", blank())
    dataset = Masks(tmp_path)
    assert [sample.name for sample in dataset] == ["a.jpg", "images/b.png"]
    assert dataset[0].image == tmp_path / "a.jpg"
    assert dataset[0].size == SIZE
    assert as_lists(dataset[0].polylines) == [level(20), level(40)]
    assert dataset[0].polylines.labels.tolist() == [0, 0]
    assert len(dataset[1].polylines) == 0
    assert dataset.classes == ("line",)
    assert not dataset.directed
    assert Masks(tmp_path, directed=True).directed


@pytest.mark.parametrize(
    ("image", "mask", "options"),
    [
        ("train/images/a.jpg", "train/masks/a.png", {"labels": "train/masks"}),
        ("images/train/a.jpg", "masks/train/a.png", {}),
        ("train/a.jpg", "masks/train/a.tif", {}),
        ("train/a.jpg", "gt/train/a.png", {"labels": "gt/**/*.png"}),
        ("a.jpg", "a.png", {"labels": "*.png"}),
        ("a.png", "a_mask.png", {"suffix": "_mask"}),
        ("x/a_sat.png", "x/a_mask.png", {"suffix": "_mask", "image_suffix": "_sat"}),
        ("data/a.png", "data/a_mask.png", {"suffix": "_mask", "labels": "data"}),
        ("photos/a.png", "masks/a.png", {"images": "photos"}),
        ("photos/train/a.png", "masks/train/a.png", {"images": "photos"}),
        ("photos/a.png", "masks/train/a.png", {"images": "photos"}),
        ("frame.0007.png", "masks/frame.0007.png", {}),
        ("images/a, b.png", "masks/a, b.png", {}),
    ],
)
def test_the_image_is_found(tmp_path, image, mask, options):
    photo(tmp_path / image)
    save(tmp_path / mask, stroke(30))
    (sample,) = Masks(tmp_path, **options)
    assert sample.image == tmp_path / image
    assert sample.name == image
    assert as_lists(sample.polylines) == [level(30)]


def test_masks_and_images_outside_of_the_root_are_found(tmp_path):
    photo(tmp_path / "root/a.jpg")
    save(tmp_path / "elsewhere/a.png", stroke(30))
    (sample,) = Masks(tmp_path / "root", tmp_path / "elsewhere")
    assert sample.name == "a.jpg"
    photo(tmp_path / "photos/b/a.jpg")
    save(tmp_path / "root/masks/b/a.png", stroke(30))
    (sample,) = Masks(tmp_path / "root", images=tmp_path / "photos")
    assert sample.image == tmp_path / "photos/b/a.jpg"
    assert sample.name == "b/a.jpg"


def test_names_choose_and_order(tmp_path):
    for name in "abc":
        photo(tmp_path / f"{name}.jpg")
        save(tmp_path / f"masks/{name}.png", blank())
    (tmp_path / "val.txt").write_text("c.jpg\na\n")
    assert [s.name for s in Masks(tmp_path, names="val.txt")] == ["c.jpg", "a.jpg"]


def test_values_become_classes(tmp_path):
    photo(tmp_path / "a.jpg")
    mask = stroke(20, value=1) + stroke(30, value=7) + stroke(40, value=2) + stroke(50, value=3)
    save(tmp_path / "masks/a.png", mask)
    values = {2: "joint", 1: "crack", 7: "crack", 3: "wire"}
    dataset = Masks(tmp_path, values=values)
    assert dataset.classes == ("joint", "crack", "wire")
    found = dataset[0].polylines
    assert [dataset.classes[i] for i in found.labels] == ["joint", "crack", "crack", "wire"]
    assert as_lists(found) == [level(40), level(20), level(30), level(50)]
    chosen = Masks(tmp_path, values=values, classes={"crack": "line", "joint": "line"})
    assert chosen.classes == ("line",)
    assert len(chosen[0].polylines) == 3
    assert len(Masks(tmp_path)[0].polylines) == 4


def test_lines_of_different_classes_do_not_join(tmp_path):
    photo(tmp_path / "a.jpg")
    mask = stroke(30, value=1)
    mask[10:50, 40] = 2
    save(tmp_path / "masks/a.png", mask)
    dataset = Masks(tmp_path, values={"1": "crack", "2": "joint"})
    assert dataset[0].polylines.labels.tolist() == [0, 0, 1]
    assert len(Masks(tmp_path)[0].polylines) == 4


def test_values_of_16_bits_and_of_palettes_are_read_as_they_are(tmp_path):
    image = pytest.importorskip("PIL.Image", reason="Pillow writes the palette image of this test")
    photo(tmp_path / "a.jpg")
    path = save(tmp_path / "masks/a.png", stroke(30).astype(np.uint16) // 255 * 1000)
    assert as_lists(Masks(tmp_path, values={1000: "crack"})[0].polylines) == [level(30)]
    for name in ("a.png", "a.gif"):
        path.unlink()
        path = tmp_path / "masks" / name
        indices = image.fromarray(stroke(30, value=2))
        indices.putpalette([0, 0, 0, 9, 9, 9, 200, 30, 40])
        indices.save(path, optimize=False)
        assert as_lists(Masks(tmp_path, values={2: "crack"})[0].polylines) == [level(30)]
        assert as_lists(Masks(tmp_path)[0].polylines) == [level(30)]


def test_what_is_transparent_is_no_line(tmp_path):
    photo(tmp_path / "a.jpg")
    white = np.full((*SIZE, 4), 255, np.uint8)
    white[..., 3] = stroke(30)
    save(tmp_path / "masks/a.png", white)
    assert as_lists(Masks(tmp_path)[0].polylines) == [level(30)]
    assert as_lists(Masks(tmp_path, values={255: "crack"})[0].polylines) == [level(30)]


def test_colored_lines_are_lines_but_no_values(tmp_path):
    photo(tmp_path / "a.jpg")
    save(tmp_path / "masks/a.png", np.stack([blank(), blank(), stroke(30)], axis=2))
    assert as_lists(Masks(tmp_path)[0].polylines) == [level(30)]
    with pytest.raises(LabelError, match=r"a\.png has colors, but one value"):
        Masks(tmp_path, values={255: "crack"})


def test_jpegs_are_blurred(tmp_path):
    photo(tmp_path / "a.png")
    save(tmp_path / "masks/a.jpg", stroke(29, 30, 31))
    (found,) = Masks(tmp_path)[0].polylines
    assert np.abs(found[:, 1] - 30.5).max() <= 1
    with pytest.raises(LabelError, match=r"a\.jpg is a JPEG"):
        Masks(tmp_path, values={255: "crack"})


def test_a_value_can_be_ignored(tmp_path):
    photo(tmp_path / "a.jpg")
    mask = stroke(30, value=1)
    mask[5:15, 20:50] = 255
    save(tmp_path / "masks/a.png", mask)
    for values in (None, {1: "crack"}):
        (sample,) = Masks(tmp_path, values=values, ignore_value=255)
        assert as_lists(sample.polylines) == [level(30)]
        (polygon,) = sample.ignore
        assert sorted(map(tuple, polygon.tolist())) == [(20, 5), (20, 15), (50, 5), (50, 15)]


def test_cleaning_can_be_tuned(tmp_path):
    photo(tmp_path / "a.jpg")
    mask = stroke(30)
    mask[20:30, 40] = 255
    mask[50, 10:16] = 255
    save(tmp_path / "masks/a.png", mask)
    assert len(Masks(tmp_path)[0].polylines) == 3
    assert len(Masks(tmp_path, spur=12)[0].polylines) == 1
    assert len(Masks(tmp_path, min_length=3)[0].polylines) == 4
    assert len(Masks(tmp_path, tolerance=0, holes=0)[0].polylines.vertices) > 60
    with pytest.raises(ValueError, match="spur is -1"):
        Masks(tmp_path, spur=-1)


def test_lines_are_traced_once(tmp_path, monkeypatch):
    photo(tmp_path / "a.jpg")
    path = save(tmp_path / "masks/a.png", stroke(30))
    dataset = Masks(tmp_path)
    first = dataset[0]
    path.unlink()
    assert as_lists(dataset[0].polylines) == as_lists(first.polylines)
    monkeypatch.setattr("yolino.datasets.masks._MEMORY", 1)
    save(path, stroke(30))
    dataset = Masks(tmp_path)
    assert len(dataset[0].polylines) == 1
    save(path, stroke(30, 40))
    assert len(dataset[0].polylines) == 2


def float_mask(path: Path) -> None:
    save(path.with_suffix(".tiff"), np.zeros(SIZE, np.float32))


BAD = {
    "is empty": lambda path: path.write_bytes(b""),
    "not an image": lambda path: path.write_bytes(b"\x89no image"),
    "truncated": lambda path: path.write_bytes(save(path, stroke(30)).read_bytes()[:-20]),
    "has float32 pixels": float_mask,
    r"has 81 x 60 pixels \(width x height\), but its image .*a\.jpg has 80 x 60": lambda path: save(
        path, np.zeros((60, 81), np.uint8)
    ),
}


@pytest.mark.parametrize("reason", BAD)
def test_a_bad_mask_is_named(tmp_path, reason):
    for name in "ab":
        photo(tmp_path / f"{name}.jpg")
    save(tmp_path / "masks/b.png", stroke(30))
    BAD[reason](tmp_path / "masks/a.png")
    labels = "masks/*.*"
    with pytest.raises(LabelError, match=reason) as caught:
        Masks(tmp_path, labels)
    assert "masks/a." in str(caught.value)
    assert str(caught.value).count("masks/a.") == 1
    dataset = Masks(tmp_path, labels, skip_broken=True)
    assert [sample.name for sample in dataset] == ["b.jpg"]
    assert [error.where for error in dataset.broken] == [caught.value.where]


def test_unknown_values_are_named(tmp_path):
    photo(tmp_path / "a.jpg")
    save(tmp_path / "masks/a.png", np.arange(60 * 80, dtype=np.uint8).reshape(SIZE) % 9)
    with pytest.raises(LabelError, match=r"a\.png has the values 2, 3, 4, 5, 6 \.\.\., but only 1: crack"):
        Masks(tmp_path, values={1: "crack"})
    with pytest.raises(LabelError, match=r"has the values 2, 3, 4, 5, 6, but"):
        Masks(tmp_path, values={1: "crack", 7: "x"}, ignore_value=8)


@pytest.mark.parametrize("values", [{}, {0: "a"}, {-1: "a"}, {1.5: "a"}, {"x": "a"}])
def test_bad_values_are_named(tmp_path, values):
    with pytest.raises(ValueError, match=r"^values (must name|has )"):
        Masks(tmp_path, values=values)


def test_an_image_has_one_mask(tmp_path):
    photo(tmp_path / "images/a.jpg")
    save(tmp_path / "masks/train/a.png", blank())
    save(tmp_path / "masks/val/a.png", blank())
    with pytest.raises(FileNotFoundError, match=r"train/a\.png names the image .*train/a, which does not"):
        Masks(tmp_path)
    with pytest.raises(
        LabelError, match=r"val/a\.png belongs to the image .*a\.jpg, but .*train/a\.png does too"
    ):
        Masks(tmp_path, images="images")


def test_a_broken_image_is_named(tmp_path):
    save(tmp_path / "masks/a.png", blank())
    (tmp_path / "a.png").write_bytes(b"no image")
    with pytest.raises(
        LabelError, match=r"masks/a\.png belongs to an image that cannot be read: .*a\.png is"
    ):
        Masks(tmp_path)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no labels like masks/\*\*/\*\.png"):
        Masks(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"no masks like \*\*/\*_gt\.png"):
        Masks(tmp_path, suffix="_gt")
    save(tmp_path / "masks/a.png", blank())
    with pytest.raises(FileNotFoundError, match=r"masks/a\.png names the image .*a, which does not exist"):
        Masks(tmp_path)
    assert len(Masks(tmp_path, require_images=False)) == 1
    with pytest.raises(FileNotFoundError, match=r"None of 1 masks .* ends with _gt: a.png has not"):
        Masks(tmp_path, "masks", suffix="_gt")


def test_unknown_classes_are_named(tmp_path):
    photo(tmp_path / "a.jpg")
    save(tmp_path / "masks/a.png", stroke(30))
    with pytest.raises(
        ValueError, match=r"None of the classes crack is among those of the masks .*, line: rename"
    ):
        Masks(tmp_path, classes=["crack"])
    assert Masks(tmp_path, classes={"line": "crack"}).classes == ("crack",)


def write(out: Path, *samples: Sample, **options: object) -> None:
    with MasksWriter(out, **options) as writer:
        for sample in samples:
            assert isinstance(sample.image, Path)
            photo(out / sample.name, sample.size or SIZE)
            writer.add(sample)


def sample_of(
    name: str, lines: list[list[list[float]]], labels: list[int] | None = None, **fields: object
) -> Sample:
    fields = {"size": SIZE} | fields
    return Sample(name, Path(name), Polylines.from_list(lines, labels=labels), **fields)


def test_written_masks_are_read_back(tmp_path):
    hole = np.array([[5.0, 5], [25, 5], [25, 15], [5, 15]])
    one = sample_of("a/b.jpg", [level(20), level(40)], [1, 0], ignore=(hole,))
    write(tmp_path, one, sample_of("images/c.d.png", []), classes=["crack", "Fuge ä"])
    assert json.loads((tmp_path / "masks/values.json").read_text("utf-8")) == {
        "values": {"1": "crack", "2": "Fuge ä"},
        "ignore_value": 255,
    }
    dataset = Masks(tmp_path)
    assert dataset.classes == ("crack", "Fuge ä")
    assert [sample.name for sample in dataset] == ["a/b.jpg", "images/c.d.png"]
    assert as_lists(dataset[0].polylines) == [level(40), level(20)]
    assert dataset[0].polylines.labels.tolist() == [0, 1]
    (polygon,) = dataset[0].ignore
    assert np.abs(np.sort(polygon, axis=0) - np.sort(hole, axis=0)).max() <= 1
    assert len(dataset[1].polylines) == 0
    assert dataset[1].size == SIZE


def test_masks_without_classes_have_lines(tmp_path):
    write(tmp_path, sample_of("a.jpg", [level(30)], [3]), width=5)
    mask = cv2.imread(str(tmp_path / "masks/a.png"), cv2.IMREAD_UNCHANGED)
    assert np.unique(mask).tolist() == [0, 1]
    assert (mask[:, 40] > 0).sum() == 5
    dataset = Masks(tmp_path)
    assert dataset.classes == ("line",)
    (line,) = dataset[0].polylines
    assert np.abs(line - level(30)).max() <= 2


@settings(deadline=None, max_examples=25)
@given(
    st.lists(
        st.tuples(st.tuples(st.floats(-20, 100), st.floats(-20, 80)), st.floats(0, 6.3), st.floats(30, 120)),
        max_size=3,
    ),
    st.integers(1, 4),
)
def test_what_is_written_is_read_back_to_a_few_pixels(tmp_path_factory, strokes, width):
    out = tmp_path_factory.mktemp("masks")
    lines = [[[x, y], [x + n * np.cos(a), y + n * np.sin(a)]] for (x, y), a, n in strokes]
    one = sample_of("a.png", lines)
    write(out, one, width=width)
    (sample,) = Masks(out)
    assert sample.name == "a.png"
    if len(sample.polylines):
        mask = cv2.imread(str(out / "masks/a.png"), cv2.IMREAD_UNCHANGED)
        reach = cv2.distanceTransform((mask == 0).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        at = np.clip(np.floor(sample.polylines.vertices).astype(int), 0, [SIZE[1] - 1, SIZE[0] - 1])
        assert reach[at[:, 1], at[:, 0]].max() < 6


def test_bad_samples_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"size of a\.jpg is unknown"):
        write(tmp_path, sample_of("a.jpg", [], size=None))
    with pytest.raises(ValueError, match=r"a\.jpg has a vertex that is not finite"):
        write(tmp_path, sample_of("a.jpg", [[[1, 2], [np.nan, 2]]]))
    with pytest.raises(ValueError, match=r"a\.jpg has a vertex that is not finite"):
        write(tmp_path, sample_of("a.jpg", [], ignore=(np.full((3, 2), np.inf),)))
    with pytest.raises(ValueError, match=r"The labels of a\.png and a\.jpg would both be"):
        write(tmp_path, sample_of("a.jpg", []), sample_of("a.png", []))
    with pytest.raises(ValueError, match="leads out of the folder"):
        MasksWriter(tmp_path / "out").add(sample_of("../../a.jpg", []))
    with pytest.raises(ValueError, match="at most 254 classes, but there are 255"):
        MasksWriter(tmp_path, classes=[str(i) for i in range(255)])
    with pytest.raises(ValueError, match="width of the lines is 0"):
        MasksWriter(tmp_path, width=0)


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"values": {}}', '{"values": {"1": 2}}', '{"values": {"1": "a"}, "ignore_value": "x"}'],
)
def test_a_broken_file_of_values_is_named(tmp_path, text):
    photo(tmp_path / "a.jpg")
    save(tmp_path / "masks/a.png", stroke(30))
    (tmp_path / "masks/values.json").write_text(text)
    with pytest.raises(LabelError, match=r"values\.json"):
        Masks(tmp_path)
    assert len(Masks(tmp_path, values={255: "line"})) == 1


def inside(polygons: list[np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """The even-odd rule at pixel centers, edge by edge."""
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    found = np.zeros(shape, bool)
    for polygon in polygons:
        odd = np.zeros(shape, bool)
        for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            if y0 != y1:
                crosses = (y0 <= rows) != (y1 <= rows)
                odd ^= crosses & (columns < x0 + (rows - y0) / (y1 - y0) * (x1 - x0))
        found |= odd
    return found


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 0.9), st.integers(1, 12), st.integers(1, 12))
def test_outlines_hold_exactly_their_pixels(seed, share, height, width):
    mask = np.random.default_rng(seed).random((height, width)) < share
    assert (inside(mask_to_polygons(mask), mask.shape) == mask).all()


def test_outlines_run_along_the_edges_of_pixels():
    mask = np.zeros((6, 8), bool)
    mask[1:5, 2:7] = True
    mask[2:4, 4:5] = False
    (ring,) = mask_to_polygons(mask)
    assert set(map(tuple, ring.tolist())) >= {(2, 1), (7, 1), (7, 5), (2, 5), (4, 2.5), (4, 3.5), (5, 3.5)}
    assert mask_to_polygons(np.zeros((3, 3), bool)) == []


def test_outlines_can_be_simplified():
    rows, columns = np.mgrid[:100, :100] + 0.5
    disc = np.hypot(rows - 50, columns - 50) < 40
    (exact,), (simple,) = mask_to_polygons(disc), mask_to_polygons(disc, 1.0)
    assert len(simple) < len(exact) / 3
    closed = np.stack([simple, np.roll(simple, -1, axis=0)], axis=1)
    assert distance_to_segments(exact, closed).max() <= 1.5
