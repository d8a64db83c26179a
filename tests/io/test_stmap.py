"""UV maps: the exact identity, orientation, overscan, and no half float."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from lensfit.coords import Window, px_from_uv, uv_from_px
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.io.stmap import (
    read_stmap,
    write_channel_stmaps,
    write_stmap,
)
from lensfit.rendering.uv import SourceMap

FRAME = Window.of_size(2048, 1556)


def identity_uv(frame: Window, data: Window | None = None) -> np.ndarray:
    """The map that changes nothing, as the renderer writes it."""
    return SourceMap.identity(data or frame).uv(frame)


def exact_float32(numerator: int, denominator: int) -> np.float32:
    """(numerator / 2) / denominator rounded through float64, from exact fractions."""
    return np.float32(float(Fraction(numerator, 2 * denominator)))


@pytest.mark.parametrize(
    ("width", "height"), [(2048, 1556), (4096, 2160), (1919, 1081), (3, 2), (8191, 7)]
)
def test_identity_is_exact_to_float32(width: int, height: int):
    uv = identity_uv(Window.of_size(width, height))
    assert uv.dtype == np.float32
    u = [exact_float32(2 * i + 1, width) for i in range(width)]
    v = [exact_float32(2 * i + 1, height) for i in reversed(range(height))]
    assert uv[0, :, 0].tobytes() == np.array(u).tobytes()
    assert uv[:, 0, 1].tobytes() == np.array(v).tobytes()
    assert (uv[..., 0] == uv[0, :, 0]).all()
    assert (uv[..., 1] == uv[:, :1, 1]).all()


def test_identity_over_overscan_and_offset_frames():
    frame, data = Window(10, 20, 109, 69), Window(0, 15, 120, 80)
    uv = identity_uv(frame, data)
    assert uv.shape == (66, 121, 2)
    np.testing.assert_allclose(uv, uv_from_px(data.pixel_centres(), frame), atol=1e-7)
    inside = uv[5:55, 10:110]
    assert np.array_equal(inside, identity_uv(Window.of_size(100, 50)))
    assert uv[0, 0, 0] == np.float32(-9.5 / 100)
    assert uv[-1, 0, 1] == np.float32(-10.5 / 50)


def test_origin_is_bottom_left():
    uv = identity_uv(FRAME)
    assert (uv[-1, 0] < 0.001).all()
    assert (uv[0, -1] > 0.999).all()


def test_float32_places_pixels_where_half_cannot():
    uv = identity_uv(FRAME)
    centres = FRAME.pixel_centres()
    error_px = np.abs(px_from_uv(uv, FRAME) - centres).max()
    half_error_px = np.abs(px_from_uv(uv.astype(np.half), FRAME) - centres).max()
    assert error_px < 1e-4
    assert half_error_px > 0.25


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_round_trip_keeps_bits_windows_and_attributes(tmp_path: Path, dtype: type):
    frame, data = Window.of_size(40, 30), Window(-4, -3, 43, 32)
    rng = np.random.default_rng(0)
    uv = (identity_uv(frame, data) + rng.normal(0, 0.1, (36, 48, 2))).astype(dtype)
    path = tmp_path / "map.exr"
    write_stmap(path, uv, frame, data, {"lensModel": "Takumar"})
    back = read_stmap(path)
    assert back.uv.tobytes() == uv.astype(np.float32).tobytes()
    assert (back.display_window, back.data_window) == (frame, data)
    assert back.attributes["lensModel"] == "Takumar"
    assert back.channel_uv == {}
    (part,) = read_exr(path).parts
    assert set(part.channels) == {"R", "G", "B"}
    assert (part.channels["B"] == 0).all()


def test_undefined_pixels_are_nan_in_memory_and_outside_on_disk(tmp_path: Path):
    uv = identity_uv(Window.of_size(4, 3)).copy()
    uv[1, 2, 0] = np.nan
    uv[2, 3] = np.inf
    path = tmp_path / "map.exr"
    write_stmap(path, uv, Window.of_size(4, 3))
    (part,) = read_exr(path).parts
    on_disk = np.stack([part.channels["R"], part.channels["G"]], -1)
    assert np.isfinite(on_disk).all()
    assert on_disk[1, 2].tolist() == on_disk[2, 3].tolist() == [-1, -1]
    undefined = np.isnan(read_stmap(path).uv)
    assert np.argwhere(undefined.all(-1)).tolist() == [[1, 2], [2, 3]]
    assert undefined.sum() == 4


def test_other_programs_maps_keep_their_minus_one(tmp_path: Path):
    window = Window.of_size(3, 2)
    planes = {name: np.full((2, 3), -1, np.float32) for name in ("u", "v")}
    write_exr(tmp_path / "a.exr", ExrImage((ExrPart(planes, window, window),)))
    assert (read_stmap(tmp_path / "a.exr").uv == -1).all()


def test_per_channel_maps(tmp_path: Path):
    frame = Window.of_size(8, 6)
    maps = {c: identity_uv(frame) + np.float32(i) for i, c in enumerate("rgb")}
    path = tmp_path / "map.exr"
    write_channel_stmaps(path, maps, frame)
    back = read_stmap(path)
    assert np.array_equal(back.uv, maps["g"])
    for channel, uv in maps.items():
        assert np.array_equal(back.channel_uv[channel], uv)
    with pytest.raises(ValueError, match="r, g and b"):
        write_channel_stmaps(path, {"g": maps["g"]}, frame)


def test_half_float_is_refused_both_ways(tmp_path: Path):
    frame = Window.of_size(4, 3)
    half = identity_uv(frame).astype(np.float16)
    with pytest.raises(ImageError, match="32-bit"):
        write_stmap(tmp_path / "map.exr", half, frame)
    assert list(tmp_path.iterdir()) == []
    channels = {"R": half[..., 0], "G": half[..., 1]}
    write_exr(tmp_path / "half.exr", ExrImage((ExrPart(channels, frame, frame),)))
    with pytest.raises(ImageError, match=r"half\.exr: .*32-bit"):
        read_stmap(tmp_path / "half.exr")


def test_a_picture_without_uv_is_refused(tmp_path: Path):
    frame = Window.of_size(4, 3)
    part = ExrPart({"Y": np.zeros((3, 4), np.float32)}, frame, frame)
    write_exr(tmp_path / "y.exr", ExrImage((part,)))
    with pytest.raises(ImageError, match="no UV map"):
        read_stmap(tmp_path / "y.exr")
