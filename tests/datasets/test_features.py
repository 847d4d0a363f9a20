from __future__ import annotations

import numpy as np
import pytest

from yolino.datasets.features import lengths_in_meters, to_features
from yolino.datasets.georeference import Georeference
from yolino.types import Polylines

pytest.importorskip("rasterio", reason="rasterio knows the coordinate reference systems of these tests")


def place(
    crs: str | None, x: float = 0.0, y: float = 0.0, step: float = 1.0, turn: float = 0.0
) -> Georeference:
    cos, sin = step * np.cos(turn), step * np.sin(turn)
    return Georeference(np.array([[cos, sin, x], [sin, -cos, y], [0, 0, 1]]), crs, (100, 100))


LINES = Polylines.from_list([[[0, 0], [3, 4]], [[1, 1], [1, 2], [5, 2]]], [0.9, 0.5], [1, 0])


def test_a_degree_on_the_ellipsoid() -> None:
    """Along the equator a degree is a 360th of its circumference, 111 319.49 m; along the meridian at the
    equator 110 574.28 m, and at 60 degrees of latitude 111 412 m (table of the WGS84 ellipsoid)."""
    degree = place("EPSG:4326", step=0.01)
    ways = Polylines.from_list(
        [np.stack([np.arange(101.0), np.zeros(101)], axis=1), [[0, 0], [0, 1], [0, 2]]]
    )
    meters = lengths_in_meters(ways, degree)
    np.testing.assert_allclose(meters, [111_319.4908, 0.02 * 110_574.276], rtol=1e-6)
    north = place("EPSG:4326", y=60.5, step=0.01)
    up = Polylines.from_list([np.stack([np.zeros(101), np.arange(101.0)], axis=1)])
    np.testing.assert_allclose(lengths_in_meters(up, north), 111_412.2, rtol=1e-6)


def test_meters_of_projections_are_those_on_the_ground() -> None:
    """UTM shows its middle meridian at .9996; Web Mercator at 60 degrees everything about twice too long."""
    straight = Polylines.from_list([[[0, 0], [100, 0]]])
    utm = lengths_in_meters(straight, place("EPSG:32632", 500_000, 5_400_000))
    np.testing.assert_allclose(utm, 100 / 0.9996, rtol=1e-6)
    mercator = lengths_in_meters(straight, place("EPSG:3857", 0, 8_399_737.89))
    np.testing.assert_allclose(mercator, 100 * np.cos(np.radians(60)) * 1.00251, rtol=1e-4)


def test_feet_are_meters_too() -> None:
    straight = Polylines.from_list([[[0, 0], [100, 0]]])
    feet = lengths_in_meters(straight, place("EPSG:2263", 1_000_000, 200_000))
    np.testing.assert_allclose(feet, 30.48, rtol=1e-3)


def test_a_line_over_the_date_line_is_short() -> None:
    over = Polylines.from_list([[[0, 0], [2, 0]]])
    meters = lengths_in_meters(over, place("EPSG:4326", 179.99, 0, 0.01))
    np.testing.assert_allclose(meters, 2 * 1113.1949, rtol=1e-6)


def test_a_local_system_is_measured_in_its_plane() -> None:
    local = 'LOCAL_CS["site",UNIT["US survey foot",0.304800609601219]]'
    np.testing.assert_allclose(
        lengths_in_meters(LINES, place(local)), np.array([5, 5]) * 0.3048006, rtol=1e-6
    )


def test_columns_and_coordinates() -> None:
    features = to_features(LINES, ("way", "link"), place("EPSG:32632", 5e5, 5.4e6, 2.0), {"model": "m"})
    assert list(features.columns) == ["id", "class", "score", "length_m"]
    assert features.columns["id"].tolist() == [1, 2]
    assert features.columns["class"].tolist() == ["link", "way"]
    assert features.columns["score"].tolist() == [0.9, 0.5]
    np.testing.assert_allclose(features.columns["length_m"], 10 / 0.9996, rtol=1e-5)
    np.testing.assert_allclose(next(iter(features.lines)), [[5e5, 5.4e6], [5e5 + 6, 5.4e6 - 8]])
    assert features.about == {"model": "m"}


def test_a_turned_raster_turns_its_lines() -> None:
    features = to_features(LINES, (), place("EPSG:32632", 5e5, 5.4e6, 1.0, turn=np.pi / 2))
    np.testing.assert_allclose(next(iter(features.lines)), [[5e5, 5.4e6], [5e5 + 4, 5.4e6 + 3]])
    np.testing.assert_allclose(features.columns["length_m"], 5 / 0.9996, rtol=1e-5)


@pytest.mark.parametrize("where", [None, place(None, 10, 20, 3.0)])
def test_without_a_system_lengths_are_pixels(where: Georeference | None) -> None:
    features = to_features(LINES, (), where)
    assert features.columns["length_px"].tolist() == [5, 5]
    assert features.columns["class"].tolist() == [None, None]
    assert features.crs is None
    first = [0, 0] if where is None else [10, 20]
    assert features.lines.vertices[0].tolist() == first


def test_single_points_are_no_features_and_labels_need_names() -> None:
    lines = Polylines.from_list([[[1, 1]], [[0, 0], [1, 0]]], labels=[0, 3])
    assert len(to_features(lines, (), None).lines) == 1
    with pytest.raises(ValueError, match="The label 3 has no name"):
        to_features(lines, ("a", "b"), None)
