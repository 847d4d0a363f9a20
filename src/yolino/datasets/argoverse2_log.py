"""One log of Argoverse 2: its map's center lines, its poses and the calibration of a camera."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from yolino.datasets.annotation import LabelError
from yolino.datasets.camera import Camera, Pose, quaternion_to_matrix

BY = ("none", "lane_type", "intersection")
"""What classes can be made from."""
# Every image has a pose of its own time; where it has not, the vehicle moved half a meter at most meanwhile.
_FARTHEST_NS = 20_000_000
_QUATERNION, _PLACE = ("qw", "qx", "qy", "qz"), ("tx_m", "ty_m", "tz_m")
_INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px", "height_px", "width_px")
_KINDS = {"sensor_name": ("OU", "names"), "timestamp_ns": ("iu", "whole numbers")}

Points = Float[np.ndarray, "_ 3"]


@dataclass(frozen=True, eq=False)
class Log:
    """What the projection of the lanes of a log needs.

    Attributes:
        root: Folder of the log.
        vertices: The vertices of all center lines in city coordinates, one line after the other, in meters.
        offsets: Where each line begins in `vertices`, and the end of the last.
        names: Class of each line.
        times_ns: Times of the poses, increasing, in nanoseconds.
        poses: Pose of the vehicle in the city at these times: a quaternion (w, x, y, z) and a place.
        mount: Pose of the camera on the vehicle.
        camera: The camera.
    """

    root: Path
    vertices: Float[np.ndarray, "v 3"]
    offsets: Int[np.ndarray, " n_plus_1"]
    names: tuple[str, ...]
    times_ns: Int[np.ndarray, " t"]
    poses: Float[np.ndarray, "t 7"]
    mount: Pose
    camera: Camera

    def pose_at(self, time_ns: int, where: str) -> Pose:
        """Gives the pose of the vehicle in the city that is nearest in time.

        Raises:
            LabelError: The nearest one is more than 20 ms away, or is no pose; `where` is named.
        """
        near = int(np.searchsorted(self.times_ns, time_ns))
        both = [i for i in (near - 1, near) if 0 <= i < len(self.times_ns)]
        i = min(both, key=lambda i: abs(int(self.times_ns[i]) - time_ns))
        apart = abs(int(self.times_ns[i]) - time_ns)
        if apart > _FARTHEST_NS:
            raise LabelError(
                where, f"is {apart / 1e6:.0f} ms away from the nearest pose, but at most 20 are allowed"
            )
        return _pose(self.poses[i].tolist(), where)


def read_log(path: Path, camera: str, by: str) -> Log:
    """Gives the log that a map belongs to.

    Args:
        path: The map, `<log>/map/log_map_archive_*.json`.
        camera: Name of the camera.
        by: What the classes are made from, one of `BY`.

    Raises:
        LabelError: A file is missing or does not hold what is needed.
    """
    root = path.parent.parent
    lines, names = _read_lanes(path, by)
    poses = _read_table(root / "city_SE3_egovehicle.feather", ("timestamp_ns", *_QUATERNION, *_PLACE))
    order = np.argsort(poses["timestamp_ns"], kind="stable")
    mounts = root / "calibration" / "egovehicle_SE3_sensor.feather"
    mount = _row_of(mounts, camera, (*_QUATERNION, *_PLACE))
    fx, fy, cx, cy, height, width = _row_of(root / "calibration" / "intrinsics.feather", camera, _INTRINSICS)
    return Log(
        root,
        np.concatenate([np.zeros((0, 3)), *lines]),
        np.cumsum([0, *map(len, lines)]),
        names,
        poses["timestamp_ns"][order].astype(np.int64),
        np.stack([poses[key][order] for key in (*_QUATERNION, *_PLACE)], axis=1).astype(np.float64),
        _pose(mount, str(mounts)),
        Camera((fx, fy), (cx + 0.5, cy + 0.5), (int(height), int(width))),
    )


def _read_lanes(path: Path, by: str) -> tuple[list[Points], tuple[str, ...]]:
    """Gives the center line and the class of each lane segment of a map."""
    try:
        document = json.loads(path.read_bytes())
    except ValueError:
        raise LabelError(str(path), "is not valid JSON, but a map of Argoverse 2 is needed") from None
    lanes = document.get("lane_segments") if isinstance(document, dict) else None
    if not isinstance(lanes, dict):
        raise LabelError(str(path), "has no lane_segments, which a map of Argoverse 2 has")
    lines, names = [], []
    for key, lane in lanes.items():
        where = f"{path}, lane segment {key}"
        if not isinstance(lane, dict):
            raise LabelError(where, f"is a {type(lane).__name__}, but an object is needed")
        if "centerline" in lane:
            lines.append(_points(lane, "centerline", where))
        else:
            left, right = (_points(lane, f"{side}_lane_boundary", where) for side in ("left", "right"))
            lines.append(center_line(left, right))
        names.append(_class_of(lane, by, where))
    return lines, tuple(names)


def _points(lane: dict[str, Any], key: str, where: str) -> Points:
    """Gives the points `{x, y, z}` of a lane segment."""
    given = lane.get(key)
    if not isinstance(given, list) or not given:
        raise LabelError(where, f"has no {key}, but a list of points is needed")
    try:
        points = np.array([[point[axis] for axis in "xyz"] for point in given], np.float64)
    except (TypeError, KeyError, ValueError):
        points = np.full((1, 3), np.nan)
    if not np.isfinite(points).all():
        raise LabelError(
            where, f"has a {key} with a point that is not of the form {{x, y, z}}, finite numbers"
        )
    return points


def _class_of(lane: dict[str, Any], by: str, where: str) -> str:
    if by == "none":
        return "centerline"
    key = "lane_type" if by == "lane_type" else "is_intersection"
    value = lane.get(key)
    if not isinstance(value, str if by == "lane_type" else bool):
        raise LabelError(where, f"has the {key} {value!r}, by which it cannot be classified")
    return value if isinstance(value, str) else ("intersection" if value else "lane")


def center_line(left: Points, right: Points) -> Points:
    """Gives the mean of two lines that are walked from start to end in the same time at constant speed.

    It has a vertex for each vertex of either line, so that nothing is lost.
    """
    shares = [_shares(line) for line in (left, right)]
    at = np.unique(np.concatenate(shares))
    both = [
        np.stack([np.interp(at, share, line[:, axis]) for axis in range(3)], axis=1)
        for line, share in zip((left, right), shares, strict=True)
    ]
    return np.asarray((both[0] + both[1]) / 2)


def _shares(line: Points) -> Float[np.ndarray, " v"]:
    """Gives the share of the line's length that lies before each vertex."""
    lengths = np.append(0.0, np.cumsum(np.sqrt((np.diff(line, axis=0) ** 2).sum(axis=1))))
    return np.asarray(lengths / lengths[-1] if lengths[-1] > 0 else lengths)


def _pose(values: list[float], where: str) -> Pose:
    """Gives the pose of a quaternion (w, x, y, z) and a place."""
    try:
        pose = Pose(quaternion_to_matrix(*values[:4]), np.array(values[4:], np.float64))
    except ValueError as error:
        raise LabelError(where, f"has no valid pose ({str(error).removesuffix('.')})") from None
    if not np.isfinite(pose.translation).all():
        raise LabelError(where, f"has no valid pose (its place is {values[4:]})")
    return pose


def _row_of(path: Path, camera: str, keys: tuple[str, ...]) -> list[float]:
    """Gives the row of a camera in a table of sensors."""
    table = _read_table(path, ("sensor_name", *keys))
    names = [str(name) for name in table["sensor_name"]]
    if camera not in names:
        raise LabelError(str(path), f"has no camera {camera}; its sensors are {', '.join(names)}")
    row = [float(table[key][names.index(camera)]) for key in keys]
    if not np.isfinite(row).all():
        raise LabelError(str(path), f"has numbers for {camera} that are not finite")
    return row


def _read_table(path: Path, keys: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Gives columns of a Feather file, which is one of Arrow."""
    from pyarrow import ArrowException, ipc

    if not path.is_file():
        raise LabelError(str(path), "does not exist, but a log needs it")
    try:
        table = ipc.open_file(path.read_bytes()).read_all()
    except ArrowException as error:
        raise LabelError(str(path), f"is no Feather file ({str(error).splitlines()[0]})") from None
    if table.num_rows == 0:
        raise LabelError(str(path), "is empty, but at least one row is needed")
    if missing := [key for key in keys if key not in table.column_names]:
        raise LabelError(str(path), f"has no column {' and '.join(missing)}, which is needed")
    columns = {key: table[key].to_numpy() for key in keys}
    for key, column in columns.items():
        kinds, wanted = _KINDS.get(key, ("iuf", "numbers"))
        if column.dtype.kind not in kinds:
            raise LabelError(str(path), f"has a column {key} of {column.dtype}, but {wanted} are needed")
    return columns


__all__ = ["BY", "Log", "center_line", "read_log"]
