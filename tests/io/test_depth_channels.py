"""Depth channels: every way of writing one distance reads as that distance."""

import numpy as np
import pytest

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.depth_channel import (
    DepthMeaning,
    depth_over_window,
    find_depth,
    perpendicular_mm,
    ray_slant,
    unit_in_mm,
    without_nan,
)
from lensfit.io.exr import ExrImage, ExrPart

WINDOW = Window.of_size(4, 3)
DISTANCE_MM = np.float32([[500, 1000, 4000, 20000]])


def part(name="", window=WINDOW, dtype=np.float32, **channels):
    size = (window.height, window.width)
    planes = {
        k.replace("__", "."): np.full(size, v, dtype) for k, v in channels.items()
    }
    return ExrPart(planes, window, WINDOW, name=name)


@pytest.mark.parametrize(
    ("unit", "millimetres"),
    [("mm", 1), ("cm", 10), ("m", 1000), ("in", 25.4), ("ft", 304.8), ("12.5", 12.5)],
)
def test_units(unit, millimetres):
    assert unit_in_mm(unit) == pytest.approx(millimetres)
    meaning = DepthMeaning(unit_in_mm(unit))
    read = perpendicular_mm(DISTANCE_MM / np.float32(millimetres), meaning, 1.0)
    assert read == pytest.approx(DISTANCE_MM, rel=1e-6)


@pytest.mark.parametrize("unit", ["yard", "0", "-1", "inf", "nan", ""])
def test_what_is_no_unit(unit):
    with pytest.raises(ImageError, match="no unit"):
        unit_in_mm(unit)


def test_an_inverted_depth_has_its_sky_at_zero():
    """1 at the near plane and 0 at the far one: near and far change places."""
    samples = np.array([1.0, 0.75, 0.001, 0.0, -0.1, 1.1], np.float32)
    found = perpendicular_mm(samples, DepthMeaning(1000, "normalised", 50, 2), 1.0)
    np.testing.assert_allclose(found[:3], [2000, 14000, 49952], rtol=1e-5)
    assert np.isposinf(found[3:]).all()


def test_inverse_and_normalised():
    inverse = perpendicular_mm(1000 / DISTANCE_MM, DepthMeaning(1000, "inverse"), 1.0)
    assert inverse == pytest.approx(DISTANCE_MM, rel=1e-6)
    share = (DISTANCE_MM / 1000 - 0.25) / (50 - 0.25)
    meaning = DepthMeaning(1000, "normalised", 0.25, 50)
    assert perpendicular_mm(share, meaning, 1.0) == pytest.approx(DISTANCE_MM, rel=1e-5)


def test_a_wall_is_flat_whichever_way_its_distance_is_measured():
    # A wall at 3 m: along the rays its distance grows towards the corner.
    offsets = np.moveaxis(np.mgrid[-10.0:11, -18.0:19], 0, -1)[..., ::-1]
    along_ray = 3.0 * np.sqrt(35**2 + (offsets**2).sum(-1)) / 35
    read = perpendicular_mm(
        along_ray, DepthMeaning(1000, "ray"), ray_slant(offsets, 35.0)
    )
    assert along_ray.max() > 3.3
    assert read == pytest.approx(3000, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "sky"),
    [
        ("perpendicular", [np.inf, 0, -1, 1e10, 1e30, -np.inf]),
        ("ray", [np.inf, 0, -1, 1e10]),
        ("inverse", [0, -1, 1e-12, np.inf]),
        ("normalised", [1, 2, -0.1, np.inf]),
    ],
)
def test_the_sky_is_infinitely_far(kind, sky):
    read = perpendicular_mm(np.float32(sky), DepthMeaning(1000, kind, 1, 100), 1.2)
    assert np.isposinf(read).all()


def test_half_floats_end_in_the_sky():
    plane = depth_over_window(part(Z=65504, dtype=np.float16), "Z", WINDOW)
    assert np.isposinf(plane).all()
    assert plane.dtype == np.float32


def test_nan_takes_the_nearest_distance():
    depth = np.float32([[1, np.nan, np.nan, 5], [1, np.nan, 5, 5]])
    assert without_nan(depth).tolist() == [[1, 1, 5, 5], [1, 1, 5, 5]]
    assert np.isposinf(without_nan(np.full((2, 2), np.nan, np.float32))).all()


def test_another_data_window_is_brought_over():
    small = part(window=Window(1, 1, 2, 2), Z=7.0)
    plane = depth_over_window(small, "Z", WINDOW)
    assert plane[1:3, 1:3].tolist() == [[7, 7], [7, 7]]
    assert np.isnan(plane).sum() == 8


@pytest.mark.parametrize(
    ("parts", "wanted", "name"),
    [
        ([part(R=1, Z=2)], None, "Z"),
        ([part(R=1, depth__Z=2)], None, "depth.Z"),
        ([part(R=1, normal__Z=2, depth__Z=3)], None, "depth.Z"),
        ([part(R=1, Depth=2)], None, "Depth"),
        ([part("rgb", R=1), part("depth", Y=2)], None, "Y"),
        ([part("rgb", R=1), part("aov", mist=2)], "mist", "mist"),
        ([part("rgb", R=1), part("aov", mist=2)], "aov.mist", "mist"),
        ([part(R=1, G=2)], None, None),
        ([part(R=1, P__X=1, P__Y=1, P__Z=2, Z=3)], None, "Z"),
        ([part(R=1, N__X=1, N__Y=1, N__Z=2)], None, None),
        ([part(R=1, N__X=1, N__Y=1, N__Z=2)], "N.Z", "N.Z"),
    ],
)
def test_the_channel_is_found(parts, wanted, name):
    found = find_depth(ExrImage(tuple(parts)), wanted, parts[0])
    assert (found and found.name) == name


def test_a_channel_that_is_not_there_names_what_is():
    with pytest.raises(ImageError, match=r"'far'.*R, Z"):
        find_depth(ExrImage((part(R=1, Z=2),)), "far")
