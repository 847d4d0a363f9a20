from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.argoverse2 import Argoverse2
from yolino.datasets.argoverse2_log import center_line
from yolino.geometry import distance_to_segments
from yolino.types import Polylines

pa = pytest.importorskip("pyarrow", reason="pyarrow writes the tables of the logs of these tests")

SIZE = (60, 80)
TIME = 315966253572412942
HALF = math.sqrt(0.5)
# The vehicle drives along the city's y; the camera is 1.5 m before its origin, 1.4 m high, and looks ahead.
VEHICLE = [HALF, 0.0, 0.0, HALF, 100.0, 200.0, 10.0]
MOUNT = [0.5, -0.5, 0.5, -0.5, 1.5, 0.0, 1.4]
INTRINSICS = [100.0, 100.0, 40.0, 30.0, -0.3, 0.1, 0.2, *SIZE]
POSE_KEYS = ["qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"]
INTRINSIC_KEYS = ["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "k3", "height_px", "width_px"]
CAMERAS = ["ring_front_center", "ring_rear_left"]
Lane = dict[str, Any]


def city(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    """Gives a point ahead (x) and to the left (y) of the vehicle in the city."""
    return {"x": 100.0 - y, "y": 200.0 + x, "z": 10.0 + z}


def lane(*places: tuple[float, float], half_width: float = 2.0, **fields: object) -> Lane:
    """A lane whose center line runs through places before the vehicle."""
    left = [city(x, y + half_width) for x, y in places]
    right = [city(x, y - half_width) for x, y in places]
    given = {
        "id": 7,
        "is_intersection": False,
        "lane_type": "VEHICLE",
        "left_lane_boundary": left,
        "right_lane_boundary": right,
        "left_lane_mark_type": "NONE",
        "right_lane_mark_type": "NONE",
        "successors": [],
        "predecessors": [],
        "left_neighbor_id": None,
        "right_neighbor_id": None,
    }
    return given | fields


AHEAD = lane((11.5, 2.0), (21.5, 2.0))
# Camera frame: (-2, 1.4, 10) and (-2, 1.4, 20).
AHEAD_PX = [[20.5, 44.5], [30.5, 37.5]]


def write_table(path: Path, columns: dict[str, list[Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.table(columns)
    with pa.OSFile(str(path), "wb") as file, pa.ipc.new_file(file, table.schema) as writer:
        writer.write_table(table)


def poses(*rows: list[float], times: list[int]) -> dict[str, list[Any]]:
    return {"timestamp_ns": times} | {key: [row[i] for row in rows] for i, key in enumerate(POSE_KEYS)}


def sensors(keys: list[str], row: list[float]) -> dict[str, list[Any]]:
    """The row for the first camera, something else for the second."""
    other = [value + 1 for value in row]
    columns = {key: [row[i], other[i]] for i, key in enumerate(keys)}
    whole = ("height_px", "width_px")
    return {"sensor_name": CAMERAS} | {k: list(map(int, v)) if k in whole else v for k, v in columns.items()}


def write_log(root: Path, *lanes: Lane, images: int = 1, name: str = "0a1b-log") -> Path:
    """Writes a log in the layout that is published."""
    log = root / name
    (log / "map").mkdir(parents=True)
    document = {
        "pedestrian_crossings": {},
        "lane_segments": {str(i): one for i, one in enumerate(lanes)},
        "drivable_areas": {},
    }
    (log / f"map/log_map_archive_{name}____PIT_city_47896.json").write_text(json.dumps(document))
    times = [TIME + i * 50_000_000 for i in range(images)]
    write_table(log / "city_SE3_egovehicle.feather", poses(*[VEHICLE] * images, times=times))
    write_table(log / "calibration/egovehicle_SE3_sensor.feather", sensors(POSE_KEYS, MOUNT))
    write_table(log / "calibration/intrinsics.feather", sensors(INTRINSIC_KEYS, INTRINSICS))
    folder = log / "sensors/cameras/ring_front_center"
    folder.mkdir(parents=True)
    for time in times:
        assert cv2.imwrite(str(folder / f"{time}.jpg"), np.zeros((*SIZE, 3), np.uint8))
    return log


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [line.tolist() for line in polylines]


def assert_lines(polylines: Polylines, expected: list[list[list[float]]]) -> None:
    assert len(polylines) == len(expected)
    for line, wanted in zip(polylines, expected, strict=True):
        assert np.allclose(line, wanted), (line, wanted)


def test_center_lines_are_projected_into_the_image(tmp_path):
    log = write_log(tmp_path, AHEAD)
    dataset = Argoverse2(tmp_path)
    (sample,) = dataset
    assert sample.name == f"0a1b-log/sensors/cameras/ring_front_center/{TIME}.jpg"
    assert sample.image == log / f"sensors/cameras/ring_front_center/{TIME}.jpg"
    assert sample.size == SIZE
    assert_lines(sample.polylines, [AHEAD_PX])
    assert dataset.classes == ("centerline",)
    assert dataset.directed


def test_the_direction_of_a_lane_is_kept(tmp_path):
    write_log(tmp_path, lane((21.5, 2.0), (11.5, 2.0)))
    assert_lines(Argoverse2(tmp_path)[0].polylines, [AHEAD_PX[::-1]])


def test_lanes_behind_beside_and_far_away_are_not_seen(tmp_path):
    behind, beside = lane((-20.0, 0.0), (-5.0, 0.0)), lane((11.5, 30.0), (21.5, 30.0))
    far = lane((91.5, 2.0), (96.5, 2.0))
    write_log(tmp_path, behind, beside, far)
    assert len(Argoverse2(tmp_path)[0].polylines) == 0
    # 90 m ahead, 2 m left, 1.4 m below.
    assert_lines(
        Argoverse2(tmp_path, max_distance=None)[0].polylines,
        [[[40.5 - 200 / 90, 30.5 + 140 / 90], [40.5 - 200 / 95, 30.5 + 140 / 95]]],
    )


def test_a_lane_from_behind_begins_at_the_border_of_the_image(tmp_path):
    write_log(tmp_path, lane((-20.0, 0.0), (21.5, 0.0)))
    assert_lines(Argoverse2(tmp_path)[0].polylines, [[[40.5, 60.0], [40.5, 37.5]]])


def test_a_lane_ends_at_the_largest_distance(tmp_path):
    write_log(tmp_path, lane((11.5, 2.0), (101.5, 2.0)))
    (line,) = Argoverse2(tmp_path, max_distance=30)[0].polylines
    ahead = math.sqrt(30**2 - 2**2 - 1.4**2)
    assert np.allclose(line, [AHEAD_PX[0], [40.5 - 200 / ahead, 30.5 + 140 / ahead]])


def test_lanes_that_follow_each_other_share_a_vertex_exactly(tmp_path):
    middle = (17.3, 1.1)
    write_log(
        tmp_path,
        lane((11.5, 2.0), middle),
        lane(middle, (25.0, 3.7)),
        lane(middle, (26.0, -3.3), half_width=1.7),
    )
    one, two, three = as_lists(Argoverse2(tmp_path)[0].polylines)
    assert one[-1] == two[0]
    assert np.allclose(two[0], three[0])


def test_every_log_below_the_root_is_found(tmp_path):
    first = write_log(tmp_path / "sensor/val", AHEAD, images=2, name="a")
    write_log(tmp_path / "sensor/val", AHEAD, name="b")
    write_log(tmp_path / "sensor/train", AHEAD, name="c")
    image = f"sensors/cameras/ring_front_center/{TIME}.jpg"
    assert [s.name for s in Argoverse2(first)][:1] == [image]
    assert len(Argoverse2(first)) == 2
    assert len(Argoverse2(tmp_path / "sensor/val")) == 3
    both = Argoverse2(tmp_path / "sensor")
    assert [s.name.split("/")[:2] for s in both] == [["train", "c"], ["val", "a"], ["val", "a"], ["val", "b"]]
    assert len(Argoverse2(tmp_path / "sensor", "train")) == 1
    assert len(Argoverse2(tmp_path / "sensor", ["train", "val/b"])) == 2
    assert Argoverse2(tmp_path / "sensor/val", "b")[0].name == f"b/{image}"
    assert (
        len(Argoverse2(tmp_path / "sensor/val", first / "map/log_map_archive_a____PIT_city_47896.json")) == 2
    )
    (outside,) = Argoverse2(tmp_path / "sensor/val", tmp_path / "sensor/train/c")
    assert outside.image == tmp_path / "sensor/train/c" / image


def test_images_can_be_skipped_and_chosen(tmp_path):
    write_log(tmp_path, AHEAD, images=7)
    times = [int(Path(s.name).stem) - TIME for s in Argoverse2(tmp_path, every=3)]
    assert times == [0, 150_000_000, 300_000_000]
    (tmp_path / "val.txt").write_text(f"{TIME + 50_000_000}\n")
    assert len(Argoverse2(tmp_path, names="val.txt")) == 1


def test_the_nearest_pose_counts(tmp_path):
    log = write_log(tmp_path, AHEAD)
    moved = [*VEHICLE[:5], 190.0, 10.0]
    times = [TIME + 9_000_000, TIME - 8_000_000, TIME + 30_000_000]
    write_table(log / "city_SE3_egovehicle.feather", poses(moved, VEHICLE, moved, times=times))
    assert_lines(Argoverse2(tmp_path)[0].polylines, [AHEAD_PX])


def test_classes_come_from_the_type_or_the_place_of_a_lane(tmp_path):
    bike = lane((11.5, -2.0), (21.5, -2.0), lane_type="BIKE")
    crossing = lane((11.5, 0.0), (21.5, 0.0), is_intersection=True)
    write_log(tmp_path, AHEAD, bike, crossing)
    dataset = Argoverse2(tmp_path, by="lane_type")
    assert dataset.classes == ("BIKE", "VEHICLE")
    assert dataset[0].polylines.labels.tolist() == [1, 0, 1]
    dataset = Argoverse2(tmp_path, by="intersection", classes=["lane", "intersection"])
    assert dataset[0].polylines.labels.tolist() == [0, 0, 1]
    dataset = Argoverse2(tmp_path, by="lane_type", classes={"VEHICLE": "road", "BUS": "road"})
    assert dataset.classes == ("road",)
    assert len(dataset[0].polylines) == 2
    assert dataset.left_out == {"BIKE": 1}
    with pytest.raises(
        ValueError, match=r"None of the classes BUS occurs in .*; by lane_type .* BIKE, VEHICLE"
    ):
        Argoverse2(tmp_path, by="lane_type", classes=["BUS"])


def test_other_cameras_have_their_own_calibration(tmp_path):
    log = write_log(tmp_path, AHEAD)
    with pytest.raises(LabelError, match=r"has no images sensors/cameras/ring_rear_left/\*\.jpg"):
        Argoverse2(tmp_path, camera="ring_rear_left")
    folder = log / "sensors/cameras/ring_rear_left"
    folder.mkdir()
    cv2.imwrite(str(folder / f"{TIME}.jpg"), np.zeros((61, 81, 3), np.uint8))
    assert Argoverse2(tmp_path, camera="ring_rear_left")[0].size == (61, 81)
    with pytest.raises(
        LabelError, match="has no camera front; its sensors are ring_front_center, ring_rear_left"
    ):
        Argoverse2(tmp_path, camera="front")


def test_a_given_center_line_is_taken(tmp_path):
    given = lane((11.5, 9.0), (21.5, 9.0), centerline=[city(11.5, 2.0), city(21.5, 2.0)])
    write_log(tmp_path, given)
    assert_lines(Argoverse2(tmp_path)[0].polylines, [AHEAD_PX])


def test_the_center_line_is_the_mean_of_the_boundaries():
    left = np.array([[0.0, 2, 0], [6, 2, 0], [8, 2, 4]])
    right = np.array([[0.0, 0, 0], [8, 0, 0]])
    length = 6 + math.hypot(2, 4)
    middle = np.array([6, 2, 0]) / 2 + np.array([8 * 6 / length, 0, 0]) / 2
    assert np.allclose(center_line(left, right), [[0, 1, 0], middle, [8, 1, 2]])
    assert center_line(left[:1], right).tolist() == [[0, 1, 0], [4, 1, 0]]
    assert center_line(np.zeros((3, 3)), right).tolist() == [[0, 0, 0], [4, 0, 0]]


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_center_line_is_that_of_many_pairs_of_points(seed):
    rng = np.random.default_rng(seed)
    left, right = (rng.normal(size=(rng.integers(2, 6), 3)).cumsum(axis=0) for _ in range(2))
    found = center_line(left, right)

    def walk(line: np.ndarray, share: float) -> np.ndarray:
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
        rest = share * steps.sum()
        for start, end, step in zip(line[:-1], line[1:], steps, strict=True):
            if rest <= step:
                return start + (end - start) * rest / step
            rest -= step
        return line[-1]

    points = np.array([(walk(left, t) + walk(right, t)) / 2 for t in np.linspace(0, 1, 30)])
    for axes in ([0, 1], [1, 2]):
        pieces = np.stack([found[:-1], found[1:]], axis=1)[..., axes]
        assert distance_to_segments(points[:, axes], pieces).max() < 1e-6
    assert found[0].tolist() == ((left[0] + right[0]) / 2).tolist()
    assert found[-1].tolist() == ((left[-1] + right[-1]) / 2).tolist()


def the_map(log: Path) -> Path:
    (path,) = (log / "map").glob("*.json")
    return path


def spoil_map(text: str) -> Callable[[Path], object]:
    return lambda log: the_map(log).write_text(text)


def spoil_lane(**fields: object) -> Callable[[Path], object]:
    bad = {key: value for key, value in (AHEAD | fields).items() if value is not None}
    return spoil_map(json.dumps({"lane_segments": {"5": AHEAD, "38109167": bad}}))


def spoil_table(name: str, **columns: list[Any] | None) -> Callable[[Path], object]:
    def spoil(log: Path) -> None:
        whole = {
            "city_SE3_egovehicle": poses(VEHICLE, times=[TIME]),
            "calibration/egovehicle_SE3_sensor": sensors(POSE_KEYS, MOUNT),
            "calibration/intrinsics": sensors(INTRINSIC_KEYS, INTRINSICS),
        }[name] | columns
        write_table(log / f"{name}.feather", {k: v for k, v in whole.items() if v is not None})

    return spoil


def photo(log: Path, name: str, size: tuple[int, int] = SIZE) -> Path:
    path = log / "sensors/cameras/ring_front_center" / name
    assert cv2.imwrite(str(path), np.zeros((*size, 3), np.uint8))
    return path


BAD: dict[str, Callable[[Path], object]] = {
    r"47896\.json is not valid JSON": spoil_map("{"),
    r"47896\.json has no lane_segments": spoil_map("[]"),
    r"json has no lane_segments": spoil_map('{"lane_segments": []}'),
    r"lane segment 1 is a int": spoil_map('{"lane_segments": {"1": 3}}'),
    r"lane segment 38109167 has no left_lane_boundary": spoil_lane(left_lane_boundary=None),
    r"lane segment 38109167 has no right_lane_boundary": spoil_lane(right_lane_boundary=[]),
    r"has a left_lane_boundary with a point": spoil_lane(left_lane_boundary=[{"x": 1, "y": 2}]),
    r"has a right_lane_boundary with a point": spoil_lane(right_lane_boundary=[[1, 2, 3]]),
    r"has a centerline with a point": spoil_lane(centerline=[{"x": 1, "y": 2, "z": float("nan")}]),
    r"city_SE3_egovehicle\.feather does not": lambda log: (log / "city_SE3_egovehicle.feather").unlink(),
    r"intrinsics\.feather is no Feather": lambda log: (log / "calibration/intrinsics.feather").write_text(
        "x"
    ),
    r"sensor\.feather is no Feather": lambda log: (
        log / "calibration/egovehicle_SE3_sensor.feather"
    ).write_text(""),
    r"intrinsics\.feather has no column fx_px": spoil_table("calibration/intrinsics", fx_px=None),
    r"has a column cx_px of object, but numbers": spoil_table("calibration/intrinsics", cx_px=["a", "b"]),
    r"has a column timestamp_ns of float64, but whole numbers": spoil_table(
        "city_SE3_egovehicle", timestamp_ns=[1.5]
    ),
    r"has a column sensor_name of int64, but names": spoil_table(
        "calibration/intrinsics", sensor_name=[1, 2]
    ),
    r"intrinsics\.feather has numbers for ring_front": spoil_table(
        "calibration/intrinsics", fx_px=[math.nan, 1.0]
    ),
    r"sensor\.feather has no valid pose \(The quat": spoil_table(
        "calibration/egovehicle_SE3_sensor", **{key: [0.0, 1.0] for key in POSE_KEYS[:4]}
    ),
    r"feather is empty": lambda log: write_table(log / "city_SE3_egovehicle.feather", poses(times=[])),
    r"942\.jpg has no valid pose \(The quaternion": spoil_table("city_SE3_egovehicle", qw=[math.nan]),
    r"942\.jpg has no valid pose \(its place": spoil_table("city_SE3_egovehicle", tx_m=[math.inf]),
    r"942\.jpg is 21 ms away": spoil_table("city_SE3_egovehicle", timestamp_ns=[TIME + 21_000_000]),
    r"942\.jpg has 40 x 30 pixels, but .* 80 x 60": lambda log: photo(log, f"{TIME}.jpg", (30, 40)),
    r"has a broken image: .*942\.jpg is": lambda log: photo(log, f"{TIME}.jpg").write_bytes(b"no image"),
    r"image front\.jpg is not named by its time": lambda log: photo(log, f"{TIME}.jpg").rename(
        log / "sensors/cameras/ring_front_center/front.jpg"
    ),
}


@pytest.mark.parametrize("reason", BAD)
def test_a_broken_log_is_named_and_can_be_skipped(tmp_path, reason):
    log = write_log(tmp_path, AHEAD, name="broken")
    write_log(tmp_path, AHEAD, name="whole")
    BAD[reason](log)
    with pytest.raises(LabelError, match=reason) as caught:
        Argoverse2(tmp_path)
    assert str(log) in str(caught.value)
    dataset = Argoverse2(tmp_path, skip_broken=True)
    assert [sample.name.split("/")[0] for sample in dataset] == ["whole"]
    assert [error.where for error in dataset.broken] == [caught.value.where]


def test_lanes_without_a_class_are_named(tmp_path):
    write_log(tmp_path, lane((1.0, 2.0), (2.0, 2.0), lane_type=None, is_intersection="no"))
    for by, reason in (("lane_type", "the lane_type None"), ("intersection", "the is_intersection 'no'")):
        with pytest.raises(LabelError, match=f"lane segment 0 has {reason}, by which"):
            Argoverse2(tmp_path, by=by)


def test_bad_arguments_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="no labels like map/log_map_archive"):
        Argoverse2(tmp_path)
    for options, reason in (
        ({"by": "color"}, "by 'color', but must be by none, lane_type, intersection"),
        ({"every": 0}, "every is 0"),
        ({"max_distance": 0}, "max_distance is 0"),
        ({"max_distance": float("nan")}, "max_distance is nan"),
    ):
        with pytest.raises(ValueError, match=reason):
            Argoverse2(tmp_path, **options)


def test_logs_without_lanes_are_empty_images(tmp_path):
    write_log(tmp_path)
    dataset = Argoverse2(tmp_path)
    assert len(dataset[0].polylines) == 0
    assert dataset.classes == ("centerline",)
