"""OpenEXR files survive a round trip bit for bit; bad ones are refused in a line."""

import os
import resource
import struct
import sys
import threading
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import Imath
import numpy as np
import OpenEXR
import pytest

from lensfit.coords import Window
from lensfit.errors import ImageError, OutputError
from lensfit.io.exr import (
    ExrImage,
    ExrPart,
    colour_channels,
    find_colour,
    layer_names,
    read_exr,
    stack_channels,
    with_channels,
    write_exr,
)
from lensfit.io.exr_header import check_exr

OVERSCANNED = Window(-3, -2, 9, 7)
ATTRIBUTES = {
    "owner": "Zoë →",
    "empty": "",
    "focus": 1.25,
    "imageCounter": 7,
    "flag": 1,
    "v2f": np.array([1.5, -2.0], np.float32),
    "v2i": np.array([1, -2], np.int32),
    "v2d": np.array([0.1, 0.2]),
    "v3f": np.array([1.5, -2.0, 3.0], np.float32),
    "v3i": np.array([1, 2, 3], np.int32),
    "m33f": np.arange(9, dtype=np.float32).reshape(3, 3),
    "worldToCamera": np.arange(16, dtype=np.float32).reshape(4, 4),
    "m44d": np.arange(16, dtype=np.float64).reshape(4, 4) / 7,
    "captureRate": Fraction(24000, 1001),
    "sensorAcquisitionRectangle": Window(1, 2, 300, 400),
    "box2f": (np.array([0.5, 1], np.float32), np.array([2, 3.5], np.float32)),
    "chromaticities": (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329),
    "timeCode": OpenEXR.TimeCode(1, 2, 3, 4, *[False] * 6, *[0] * 8),
    "keyCode": OpenEXR.KeyCode(1, 2, 3, 4, 5, 4, 64),
    "multiView": ["left", "right"],
    "floats": [1.0, 2.0, 3.0, 4.0, 5.0],
    "none": [],
    "raw": OpenEXR.Bytes(b"\0\1\2", "hint"),
    "vendor": OpenEXR.OpaqueAttribute(b"abc", "vendortype"),
    "envmap": OpenEXR.ENVMAP_LATLONG,
    "cryptomatte/542cafa/name": "CryptoObject",
    "manifest": '{"' + "x" * 5000 + '": "00"}',
}


def random_part(data_window: Window = OVERSCANNED, **changes) -> ExrPart:
    rng = np.random.default_rng(4)
    size = (data_window.height, data_window.width)
    bits = rng.integers(0, 2**32, size, np.uint32)
    channels = {
        "R": rng.normal(size=size).astype(np.float16),
        "G": rng.normal(size=size).astype(np.float16),
        "B": rng.normal(size=size).astype(np.float16),
        "A": np.ones(size, np.float16),
        "depth.Z": rng.random(size).astype(np.float32),
        "CryptoObject00.r": bits.view(np.float32),
        "id": bits,
        "right.deep layer.R": np.full(size, np.nan, np.float32),
    }
    return ExrPart(channels, data_window, Window(0, 0, 6, 5), **changes)


def plain(value: object) -> object:
    """An attribute in a form that compares with ==."""
    if isinstance(value, tuple):
        return tuple(plain(item) for item in value)
    if isinstance(value, np.ndarray):
        return (value.dtype.str, value.tolist())
    if isinstance(value, (OpenEXR.Bytes, OpenEXR.OpaqueAttribute)):
        return bytes(value.data)
    if isinstance(value, (OpenEXR.TimeCode, OpenEXR.KeyCode)):
        return repr(value)
    return value


def assert_same_channels(part: ExrPart, other: ExrPart) -> None:
    assert set(part.channels) == set(other.channels)
    for name, samples in part.channels.items():
        assert other.channels[name].dtype == samples.dtype
        assert other.channels[name].tobytes() == samples.tobytes(), name


@pytest.mark.parametrize("compression", ["no", "rle", "zips", "zip", "piz"])
def test_samples_and_windows_survive_bit_for_bit(tmp_path: Path, compression: str):
    part = random_part(pixel_aspect=2.0, compression=compression)
    write_exr(tmp_path / "a.exr", ExrImage((part,)))
    (back,) = read_exr(tmp_path / "a.exr").parts
    assert_same_channels(part, back)
    assert (back.data_window, back.display_window) == (
        part.data_window,
        part.display_window,
    )
    assert (back.pixel_aspect, back.compression) == (2.0, compression)


@pytest.mark.parametrize(
    "window", [Window(2, 1, 4, 4), Window(100, 200, 103, 201), Window(0, 0, 0, 0)]
)
def test_data_window_may_lie_anywhere(tmp_path: Path, window: Window):
    part = random_part(window)
    write_exr(tmp_path / "a.exr", ExrImage((part,)))
    (back,) = read_exr(tmp_path / "a.exr").parts
    assert back.data_window == window
    assert_same_channels(part, back)


def test_every_attribute_type_survives(tmp_path: Path):
    first, second = tmp_path / "a.exr", tmp_path / "b.exr"
    write_exr(first, ExrImage((random_part(attributes=ATTRIBUTES),)))
    write_exr(second, read_exr(first))
    attributes = read_exr(first).parts[0].attributes
    for name in ATTRIBUTES.keys() - {"sensorAcquisitionRectangle", "chromaticities"}:
        assert plain(attributes[name]) == plain(ATTRIBUTES[name]), name
    corners = np.concatenate(attributes["sensorAcquisitionRectangle"])
    assert corners.tolist() == [1, 2, 300, 400]
    np.testing.assert_allclose(
        attributes["chromaticities"], ATTRIBUTES["chromaticities"], rtol=1e-6
    )
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("value", [{"a": 1}, 2**40, [1, "a"], None, Fraction(1, 2**40)])
def test_attribute_without_exr_type_is_refused_by_name(tmp_path: Path, value: object):
    part = random_part(attributes={"strange": value})
    with pytest.raises(OutputError, match="'strange'"):
        write_exr(tmp_path / "a.exr", ExrImage((part,)))
    assert list(tmp_path.iterdir()) == []


def test_several_parts(tmp_path: Path):
    left = random_part(name="left")
    right = random_part(Window(0, 0, 3, 2), attributes={"view": "right"})
    write_exr(tmp_path / "a.exr", ExrImage((left, right)))
    back = read_exr(tmp_path / "a.exr")
    assert [part.name for part in back.parts] == ["left", "part1"]
    assert back.parts[1].attributes["view"] == "right"
    for part, other in zip((left, right), back.parts, strict=True):
        assert_same_channels(part, other)


def test_rewriting_a_lossy_file_changes_no_sample(tmp_path: Path):
    write_exr(tmp_path / "a.exr", ExrImage((random_part(),)), compression="dwaa")
    lossy = read_exr(tmp_path / "a.exr")
    write_exr(tmp_path / "b.exr", lossy)
    again = read_exr(tmp_path / "b.exr")
    assert (lossy.parts[0].compression, again.parts[0].compression) == ("dwaa", "zip")
    assert_same_channels(lossy.parts[0], again.parts[0])


def test_tiles_are_read(tmp_path: Path):
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 16, 8
    samples = np.random.default_rng(0).random((50, 70)).astype(np.float32)
    header = {
        "type": OpenEXR.tiledimage,
        "compression": OpenEXR.ZIP_COMPRESSION,
        "tiles": tiles,
    }
    path = tmp_path / "a.exr"
    OpenEXR.File(header, {"G": samples}).write(str(path))
    (part,) = read_exr(path).parts
    assert part.channels["G"].tobytes() == samples.tobytes()
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(ImageError, match="truncated"):
        read_exr(path)


def test_header_only_reads_no_pixels(tmp_path: Path):
    write_exr(tmp_path / "a.exr", ExrImage((random_part(attributes={"focus": 2.0}),)))
    (part,) = read_exr(tmp_path / "a.exr", header_only=True).parts
    assert (part.channels, part.attributes["focus"]) == ({}, 2.0)


def noisy_file(path: Path) -> bytes:
    samples = np.random.default_rng(1).random((300, 300)).astype(np.float32)
    window = Window.of_size(300, 300)
    write_exr(path, ExrImage((ExrPart({"G": samples}, window, window),)))
    return path.read_bytes()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "empty"),
        (b"not a picture at all" * 20, "not an OpenEXR file; render or convert"),
        (b"\x76\x2f\x31\x01\x02\0\0\0", "damaged"),
        (b"\x76\x2f\x31\x01\x02\0\0\0" + b"x" * 900, "damaged"),
    ],
)
def test_what_is_no_exr_is_refused(tmp_path: Path, content: bytes, says: str):
    path = tmp_path / "a.exr"
    path.write_bytes(content)
    with pytest.raises(ImageError, match=says) as caught:
        read_exr(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kept", [0.999, 0.9, 0.5, 0.01, 0.001])
def test_truncated_files_are_refused(tmp_path: Path, kept: float, capfd):
    path = tmp_path / "a.exr"
    whole = noisy_file(path)
    path.write_bytes(whole[: int(len(whole) * kept)])
    with pytest.raises(ImageError, match="damaged"):
        read_exr(path)
    assert capfd.readouterr() == ("", "")


def test_undecodable_pixels_are_refused_and_nothing_is_printed(tmp_path: Path, capsys):
    path = tmp_path / "a.exr"
    ramp = np.tile(np.arange(300, dtype=np.float32), (300, 1))
    window = Window.of_size(300, 300)
    write_exr(path, ExrImage((ExrPart({"G": ramp}, window, window),)))
    content = bytearray(path.read_bytes())
    content[-200:-100] = bytes(100)
    path.write_bytes(bytes(content))
    with pytest.raises(ImageError, match="decoded"):
        read_exr(path)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    "window",
    [
        (0, 0, 99_999, 99_999),
        (0, 0, 2**28, 15),
        (-(2**31), 0, 2**31 - 1, 9),
        (10, 10, 0, 0),
    ],
)
def test_insane_sizes_are_refused_before_allocating(tmp_path: Path, window):
    path = tmp_path / "a.exr"
    content = bytearray(noisy_file(path)[:1000])
    marker = b"dataWindow\0box2i\0"
    at = content.index(marker) + len(marker) + 4
    content[at : at + 16] = struct.pack("<4i", *window)
    path.write_bytes(bytes(content))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ImageError, match="damaged"):
        read_exr(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000


@pytest.mark.parametrize(
    ("window", "says"),
    [
        ((0, 0, 19_999, 19_999), "of 20000 x 20000"),
        ((-(2**31), 0, 2**31 - 1, 9), "of 4294967296 x 10"),
        ((10, 10, 0, 0), "is empty"),
    ],
)
def test_a_frame_far_larger_than_its_pixels_is_refused(tmp_path: Path, window, says):
    path = tmp_path / "a.exr"
    content = bytearray(noisy_file(path))
    marker = b"displayWindow\0box2i\0"
    at = content.index(marker) + len(marker) + 4
    content[at : at + 16] = struct.pack("<4i", *window)
    path.write_bytes(bytes(content))
    with pytest.raises(ImageError, match=f"display window .*{says}"):
        read_exr(path)


def test_a_small_part_of_a_large_frame_is_read(tmp_path: Path):
    part = ExrPart(
        {"Y": np.ones((9, 9), np.float32)},
        Window(4000, 2000, 4008, 2008),
        Window.of_size(8192, 4320),
    )
    write_exr(tmp_path / "a.exr", ExrImage((part,)))
    (back,) = read_exr(tmp_path / "a.exr").parts
    assert back.display_window == part.display_window


@pytest.mark.parametrize(
    "name", ["rle", "zips", "zip", "piz", "pxr24", "b44a", "dwab", "htj2k256"]
)
def test_black_frames_are_as_small_as_they_can_be(tmp_path: Path, name: str):
    window = Window.of_size(4096, 1024)
    black = np.zeros((1024, 4096), np.float16)
    path = tmp_path / "a.exr"
    image = ExrImage((ExrPart(dict.fromkeys("RGBA", black), window, window),))
    write_exr(path, image, compression=name)
    (header,) = check_exr(path)
    ratio = header.bytes_uncompressed / path.stat().st_size
    assert ratio < header.largest_ratio
    assert not read_exr(path).parts[0].channels["A"].any()


@pytest.mark.parametrize("count", [5000, 60_000])
def test_more_channels_than_any_file_has_are_refused_soon(tmp_path: Path, count: int):
    path = tmp_path / "a.exr"
    content = noisy_file(path)
    marker = b"channels\0chlist\0"
    at = content.index(marker) + len(marker)
    (length,) = struct.unpack_from("<i", content, at)
    entry = struct.pack("<iIii", 2, 0, 1, 1)
    value = b"".join(b"c%d\0" % n + entry for n in range(count)) + b"\0"
    rest = content[at + 4 + length :]
    path.write_bytes(content[:at] + struct.pack("<i", len(value)) + value + rest)
    with pytest.raises(ImageError, match="damaged"):
        read_exr(path)


def refusal(path: Path) -> str | None:
    """What reading says against a file; None when it reads it."""
    try:
        read_exr(path)
    except ImageError as error:
        return str(error)
    return None


def test_every_damaged_header_byte_ends_in_a_picture_or_one_line(tmp_path: Path):
    path = tmp_path / "a.exr"
    whole = noisy_file(path)
    rng = np.random.default_rng(2)
    refusals = []
    for at in rng.integers(4, 420, 120):
        content = bytearray(whole)
        content[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(content))
        refusals.append(refusal(path))
    said = [line for line in refusals if line is not None]
    assert 20 < len(said) < 120
    assert not any("\n" in line for line in said)


def test_deep_files_are_refused(tmp_path: Path):
    path = tmp_path / "a.exr"
    content = bytearray(noisy_file(path))
    content[5] |= 0x08
    at = content.find(b"type\0string\0")
    name = b"scanlineimage"
    if at >= 0:
        content[at : at + 60] = content[at : at + 60].replace(name, b"deepscanline\0")
    path.write_bytes(bytes(content))
    with pytest.raises(ImageError, match="deep"):
        read_exr(path)


def test_subsampled_chroma_is_refused(tmp_path: Path):
    half = Imath.PixelType(Imath.PixelType.HALF)
    header = OpenEXR.Header(6, 4)
    header["channels"] = {"Y": Imath.Channel(half), "RY": Imath.Channel(half, 2, 2)}
    file = OpenEXR.OutputFile(str(tmp_path / "a.exr"), header)
    file.writePixels({"Y": bytes(2 * 24), "RY": bytes(2 * 6)})
    file.close()
    with pytest.raises(ImageError, match=r"'RY'.*reduced resolution"):
        read_exr(tmp_path / "a.exr")


def test_missing_file_is_one_line(tmp_path: Path, capfd):
    with pytest.raises(ImageError, match="No such file"):
        read_exr(tmp_path / "none.exr")
    assert capfd.readouterr() == ("", "")


def test_threads_keep_their_standard_output(tmp_path: Path, capsys):
    noisy_file(tmp_path / "a.exr")
    reader = threading.Thread(
        target=lambda: [read_exr(tmp_path / "a.exr") for _ in range(30)]
    )
    reader.start()
    for _ in range(100):
        sys.stdout.write("result\n")
    reader.join()
    sys.stdout.write("after\n")
    assert capsys.readouterr().out == "result\n" * 100 + "after\n"


def test_record_refuses_channels_that_do_not_fit():
    part = random_part()
    with pytest.raises(ValueError, match="data window"):
        replace(part, data_window=Window(0, 0, 1, 1))
    with pytest.raises(ValueError, match="float64"):
        replace(part, channels={"R": np.zeros((10, 13))})


def test_layers_and_colours():
    size = (2, 3)
    names = ["R", "G", "B", "A", "depth.Z", "spec.b", "spec.g", "spec.r", "matte.A"]
    names += ["N.X", "N.Y", "N.Z", "mask.X"]
    channels = {n: np.full(size, i, np.float32) for i, n in enumerate(names)}
    window = Window.of_size(3, 2)
    part = ExrPart(channels, window, window)
    assert layer_names(part) == ["", "depth", "spec", "matte", "N", "mask"]
    assert colour_channels(part) == ("R", "G", "B")
    assert colour_channels(part, "spec") == ("spec.r", "spec.g", "spec.b")
    for layer in ("matte", "depth", "N"):
        assert colour_channels(part, layer) == ()
    assert colour_channels(part, "mask") == ("mask.X",)
    only_z = ExrPart({"Z": channels["R"]}, window, window)
    image = ExrImage((only_z, part))
    assert find_colour(image) == (1, ("R", "G", "B"))
    with pytest.raises(ImageError, match=r"no colour .* channels are Z"):
        find_colour(ExrImage((only_z,)))
    stacked = stack_channels(part, ("spec.r", "G"))
    assert stacked[0, 0].tolist() == [7.0, 1.0]


def test_new_colour_keeps_types_and_everything_else():
    part = random_part()
    pixels = np.random.default_rng(0).random((10, 13, 3)).astype(np.float32)
    pixels[0, 0] = 1e9
    changed = with_channels(part, ("R", "G", "B"), pixels)
    assert changed.channels["R"].dtype == np.float16
    assert changed.channels["R"][0, 0] == np.finfo(np.float16).max
    assert np.array_equal(changed.channels["G"][1:], pixels[1:, :, 1].astype(np.half))
    for name in part.channels.keys() - {"R", "G", "B"}:
        assert changed.channels[name] is part.channels[name]


def test_real_plate(data_dir: Path, tmp_path: Path):
    plate = read_exr(data_dir / "plates" / "plate.0001.exr")
    (part,) = plate.parts
    assert part.data_window == Window(-48, -27, 1007, 566)
    assert part.display_window == Window.of_size(960, 540)
    assert {"depth.Z", "CryptoObject02.a", "R"} <= set(part.channels)
    write_exr(tmp_path / "copy.exr", plate)
    (copy,) = read_exr(tmp_path / "copy.exr").parts
    assert_same_channels(part, copy)
    assert {k: plain(v) for k, v in copy.attributes.items()} == {
        k: plain(v) for k, v in part.attributes.items()
    }


def test_a_name_that_is_not_utf_8_is_said(tmp_path):
    path = tmp_path / os.fsdecode(b"b\xff.exr")
    try:
        write_exr(path.with_name("b.exr"), ExrImage((random_part(),)))
        path.with_name("b.exr").rename(path)
    except OSError:
        pytest.skip("no such names here")
    with pytest.raises(ImageError, match=r"its name is not UTF-8\); rename it"):
        read_exr(path)
