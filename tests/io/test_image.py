"""Photographs come in as light, upright and whole, or are refused in one line."""

import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.io.image import camera_state_of, read_photograph
from lensfit.io.transfer import decode, encode
from lensfit.mosaic import photosites

RNG_SEED = 5


def colour_codes(dtype: type = np.uint8) -> np.ndarray:
    rng = np.random.default_rng(RNG_SEED)
    return rng.integers(0, np.iinfo(dtype).max + 1, (17, 23, 3), dtype)


def light(codes: np.ndarray, encoding: str) -> np.ndarray:
    return decode(codes / np.iinfo(codes.dtype).max, encoding)


def save_png(path: Path, codes: np.ndarray) -> None:
    """Write r, g, b (a) codes; OpenCV wants b, g, r."""
    order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[codes.shape[2]]
    assert cv2.imwrite(str(path), codes[..., order])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("encoding", [None, "linear", "logc3", "gamma2.2"])
def test_codes_become_light(tmp_path: Path, dtype: type, suffix: str, encoding):
    codes = colour_codes(dtype)
    path = tmp_path / f"a{suffix}"
    if suffix == ".png":
        save_png(path, codes)
    else:
        tifffile.imwrite(path, codes, photometric="rgb")
    photograph = read_photograph(path, encoding)
    expected = light(codes, encoding or "srgb")
    assert photograph.encoding == (encoding or "srgb")
    assert photograph.pixels.dtype == np.float32
    np.testing.assert_allclose(photograph.pixels, expected, rtol=1e-6, atol=1e-8)
    top = float(decode(np.ones(1), encoding or "srgb")[0])
    assert photograph.saturation == pytest.approx(top)
    assert photograph.metadata["bit_depth"] == 8 * codes.dtype.itemsize


def test_step_between_codes_at_mid_grey(tmp_path: Path):
    save_png(tmp_path / "a.png", colour_codes())
    step = read_photograph(tmp_path / "a.png").quantisation_step
    grey = encode(np.array(0.18), "srgb") * 255
    slope = (
        decode((grey + 0.5) / 255, "srgb") - decode((grey - 0.5) / 255, "srgb")
    ).item()
    assert step == pytest.approx(slope, rel=0.05)
    assert read_photograph(tmp_path / "a.png", "linear").quantisation_step == (
        pytest.approx(1 / 255, rel=1e-5)
    )


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_float_tiff_is_linear_and_unbounded(tmp_path: Path, dtype: type):
    pixels = (np.random.default_rng(0).normal(1, 3, (9, 8, 3))).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb")
    photograph = read_photograph(tmp_path / "a.tif")
    assert np.array_equal(photograph.pixels, pixels.astype(np.float32))
    assert (photograph.encoding, photograph.saturation) == ("linear", np.inf)
    assert photograph.quantisation_step == 0


def test_alpha_is_dropped_and_grey_stays_one_channel(tmp_path: Path):
    codes = colour_codes()
    rgba = np.concatenate([codes, codes[..., :1]], -1)
    save_png(tmp_path / "a.png", rgba)
    tifffile.imwrite(tmp_path / "a.tif", rgba, photometric="rgb", extrasamples=[2])
    for name in ("a.png", "a.tif"):
        pixels = read_photograph(tmp_path / name).pixels
        np.testing.assert_allclose(pixels, light(codes, "srgb"), rtol=1e-6)
    save_png(tmp_path / "g.png", codes[..., :1])
    photograph = read_photograph(tmp_path / "g.png")
    assert photograph.pixels.shape == (17, 23, 1)
    assert photograph.size_px == (23, 17)


def test_tiff_kinds(tmp_path: Path):
    codes = colour_codes(np.uint16)
    path = tmp_path / "a.tif"
    expected = light(codes, "linear")
    tifffile.imwrite(path, np.moveaxis(codes, -1, 0), photometric="rgb")
    np.testing.assert_allclose(read_photograph(path, "linear").pixels, expected, 1e-6)
    tifffile.imwrite(path, codes[..., 0], photometric="miniswhite")
    np.testing.assert_allclose(
        read_photograph(path, "linear").pixels[..., 0], 1 - expected[..., 0], atol=1e-6
    )
    Image.fromarray(colour_codes()).save(path, compression="tiff_lzw")
    np.testing.assert_allclose(
        read_photograph(path).pixels, light(colour_codes(), "srgb"), rtol=1e-6
    )


@pytest.mark.parametrize(
    ("sampling", "subsampled"), [("4:4:4", False), ("4:2:2", True), ("4:2:0", True)]
)
def test_jpeg_chroma(tmp_path: Path, sampling: str, subsampled: bool):
    ramp = np.linspace(0, 255, 64).astype(np.uint8)
    codes = np.stack(np.broadcast_arrays(ramp, ramp[:, None], 128), -1).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.jpg", quality=98, subsampling=sampling)
    photograph = read_photograph(tmp_path / "a.jpg", "linear")
    assert photograph.chroma_subsampled is subsampled
    np.testing.assert_allclose(photograph.pixels * 255, codes, atol=8)


def test_grey_jpeg(tmp_path: Path):
    codes = np.tile(np.arange(64, dtype=np.uint8) * 4, (64, 1))
    Image.fromarray(codes).save(tmp_path / "a.jpg", quality=98)
    photograph = read_photograph(tmp_path / "a.jpg")
    assert photograph.pixels.shape == (64, 64, 1)
    assert photograph.chroma_subsampled is False


@pytest.mark.parametrize("size", [(8, 6), (7, 6), (8, 5)])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_mosaic_turns_with_its_picture(tmp_path: Path, orientation: int, size):
    own = photosites("gbrg", size)
    codes = (own * np.array([50, 100, 200])).sum(2).astype(np.uint8)
    exif = Image.Exif()
    exif[0x112] = orientation
    Image.fromarray(codes).save(tmp_path / "a.png", exif=exif)
    Image.fromarray(np.repeat(codes[..., None], 3, 2)).save(
        tmp_path / "b.png", exif=exif
    )
    seen = read_photograph(tmp_path / "b.png", "linear").pixels[..., 0]
    for name in ("a.png", "b.png"):
        photograph = read_photograph(tmp_path / name, "linear", "gbrg")
        assert photograph.mosaic is not None
        where = photosites(photograph.mosaic, photograph.size_px)
        np.testing.assert_array_equal(
            where.argmax(2), np.searchsorted([0.3, 0.6], seen)
        )
    colours = read_photograph(tmp_path / "a.png", "linear", "gbrg").pixels * 255
    np.testing.assert_allclose(
        colours, np.broadcast_to([50, 100, 200], colours.shape), rtol=1e-5
    )


def test_a_mosaic_is_lost_where_colour_is_stored_smaller(tmp_path: Path):
    codes = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.jpg", subsampling=2)
    assert read_photograph(tmp_path / "a.jpg", "srgb", "rggb").mosaic is None


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_orientation_puts_the_scene_upright(
    tmp_path: Path, orientation: int, suffix: str
):
    scene = np.zeros((5, 8), np.uint8)
    scene[0, :] = 200  # sky
    scene[:, 0] = 100  # left
    stored = {
        1: scene,
        2: scene[:, ::-1],
        3: scene[::-1, ::-1],
        4: scene[::-1],
        5: scene.T,
        6: np.rot90(scene),
        7: scene[::-1, ::-1].T,
        8: np.rot90(scene, -1),
    }[orientation]
    path = tmp_path / f"a{suffix}"
    exif = Image.Exif()
    exif[0x112] = orientation
    Image.fromarray(np.ascontiguousarray(stored)).save(path, exif=exif)
    photograph = read_photograph(path, "linear")
    assert np.array_equal(np.rint(photograph.pixels[..., 0] * 255), scene)
    assert photograph.metadata["orientation"] == orientation


def test_exif_reaches_the_metadata(tmp_path: Path):
    exif = Image.Exif()
    exif[0x110] = "FILMIC 1"
    exif.get_ifd(0x8769).update({0x920A: 35.0, 0x829D: 2.8, 0xA405: 52})
    Image.fromarray(colour_codes()).save(tmp_path / "a.jpg", exif=exif)
    metadata = read_photograph(tmp_path / "a.jpg").metadata
    assert metadata["focal_length_mm"] == 35.0
    assert metadata["camera_model"] == "FILMIC 1"
    assert metadata["sources"]["sensor_width_mm"] == "FocalLengthIn35mmFilm"
    photograph = read_photograph(tmp_path / "a.jpg")
    assert camera_state_of(photograph).f_number == 2.8


def write_rgb(path: Path, data: Window, display: Window, **changes) -> np.ndarray:
    rng = np.random.default_rng(1)
    pixels = rng.normal(0.5, 1, (data.height, data.width, 3)).astype(np.float16)
    channels = {name: pixels[..., i] for i, name in enumerate("RGB")}
    write_exr(path, ExrImage((ExrPart(channels, data, display, **changes),)))
    return pixels.astype(np.float32)


def test_exr_is_the_display_window(tmp_path: Path):
    path = tmp_path / "a.exr"
    pixels = write_rgb(path, Window(-2, -1, 9, 8), Window.of_size(8, 6))
    photograph = read_photograph(path)
    assert np.array_equal(photograph.pixels, pixels[1:7, 2:10])
    assert (photograph.encoding, photograph.saturation) == ("linear", np.inf)
    pixels = write_rgb(path, Window(3, 2, 5, 3), Window.of_size(8, 6))
    padded = read_photograph(path).pixels
    assert np.array_equal(padded[2:4, 3:6], pixels)
    assert np.count_nonzero(padded.any(-1)) <= 6
    write_rgb(path, Window(100, 100, 101, 101), Window.of_size(8, 6))
    assert not read_photograph(path).pixels.any()


def test_bad_camera_entry_does_not_lose_the_photograph(tmp_path: Path):
    path = tmp_path / "a.exr"
    window = Window.of_size(4, 4)
    write_rgb(path, window, window, attributes={"lens/focal": "wide"})
    photograph = read_photograph(path)
    assert "lens/focal" in str(photograph.metadata["camera_problem"])
    with pytest.raises(ImageError, match=r"a\.exr: .*lens/focal"):
        camera_state_of(photograph)


def png_bytes(folder: Path) -> bytes:
    save_png(folder / "whole.png", colour_codes())
    return (folder / "whole.png").read_bytes()


def jpeg_bytes(folder: Path) -> bytes:
    Image.fromarray(np.kron(colour_codes(), np.ones((8, 8, 1), np.uint8))).save(
        folder / "whole.jpg"
    )
    return (folder / "whole.jpg").read_bytes()


def tiff_bytes(folder: Path) -> bytes:
    tifffile.imwrite(folder / "whole.tif", colour_codes(), photometric="rgb")
    return (folder / "whole.tif").read_bytes()


@pytest.mark.parametrize("make", [png_bytes, jpeg_bytes, tiff_bytes])
@pytest.mark.parametrize("kept", [0.95, 0.6, 0.1])
def test_truncated_pictures_are_refused(tmp_path: Path, make, kept: float, capfd):
    whole = make(tmp_path)
    path = tmp_path / "a.jpg"  # the name of a file says nothing
    path.write_bytes(whole)
    read_photograph(path)
    path.write_bytes(whole[: int(len(whole) * kept)])
    with pytest.raises(ImageError, match="damaged") as caught:
        read_photograph(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().out == ""


def test_harmed_png_is_refused(tmp_path: Path):
    data = bytearray(png_bytes(tmp_path))
    data[len(data) // 2] ^= 4
    (tmp_path / "a.png").write_bytes(bytes(data))
    with pytest.raises(ImageError, match="checksum"):
        read_photograph(tmp_path / "a.png")


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "is empty"), (b"<html>", "no photograph"), (b"II*\0", "damaged TIFF")],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, says: str):
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(ImageError, match=says):
        read_photograph(tmp_path / "a.tif")


def test_missing_folder_and_unknown_encoding(tmp_path: Path):
    with pytest.raises(ImageError, match=r"No such file.*; give the path of a picture"):
        read_photograph(tmp_path / "a.png")
    with pytest.raises(ImageError, match="is no ordinary file; give a picture"):
        read_photograph(tmp_path)
    with pytest.raises(ImageError, match="unknown encoding 'logx'"):
        read_photograph(tmp_path / "a.png", "logx")


@pytest.mark.parametrize("mode", ["CMYK", "P"])
def test_other_colours_are_refused(tmp_path: Path, mode: str):
    path = tmp_path / "a.tif" if mode == "P" else tmp_path / "a.jpg"
    Image.fromarray(colour_codes()).convert(mode).save(path)
    with pytest.raises(ImageError, match="colours"):
        read_photograph(path)


def test_claimed_size_is_doubted(tmp_path: Path):
    data = bytearray(png_bytes(tmp_path))
    data[16:24] = (60_000).to_bytes(4, "big") * 2
    data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    (tmp_path / "a.png").write_bytes(bytes(data))
    with pytest.raises(ImageError, match="60000 x 60000"):
        read_photograph(tmp_path / "a.png")


def test_raw_without_rawpy_names_the_extra(tmp_path: Path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rawpy", None)
    (tmp_path / "a.dng").write_bytes(tiff_bytes(tmp_path))
    with pytest.raises(ImageError, match=r"pip install 'lensfit\[raw\]'"):
        read_photograph(tmp_path / "a.dng")


def write_dng(path: Path, mosaic: np.ndarray, white: int, orientation: int = 1) -> None:
    """The least that LibRaw takes for a DNG: an RGGB mosaic, its white level, D65."""
    unit = [v for i in range(9) for v in ((1, 1) if i % 4 == 0 else (0, 1))]
    tags = [
        (50706, 1, 4, b"\x01\x04\0\0", True),  # DNGVersion
        (50708, 2, 7, "Lensfit", True),  # UniqueCameraModel
        (33421, 3, 2, (2, 2), True),  # CFARepeatPatternDim
        (33422, 1, 4, b"\0\1\1\2", True),  # CFAPattern
        (50717, 4, 1, white, True),  # WhiteLevel
        (50721, 10, 9, unit, True),  # ColorMatrix1
        (50728, 5, 3, [1, 1, 1, 1, 1, 1], True),  # AsShotNeutral
        (50778, 3, 1, 21, True),  # CalibrationIlluminant1
    ]
    tags += [(274, 3, 1, orientation, True)]
    tifffile.imwrite(path, mosaic, photometric=32803, extratags=tags)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
@pytest.mark.parametrize("size", [(96, 64), (95, 64), (96, 63)])
def test_a_raw_file_knows_where_it_measured_what(tmp_path: Path, orientation, size):
    pytest.importorskip("rawpy")
    own = photosites("rggb", size)
    codes = (own * np.array([1000, 2000, 500])).sum(2).astype(np.uint16)
    codes[:20] //= 2
    codes[:, :30] //= 2
    write_dng(tmp_path / "a.dng", codes, 4000, orientation)
    photograph = read_photograph(tmp_path / "a.dng", mosaic="rggb")
    assert photograph.mosaic is not None
    turns = {1: 0, 3: 2, 6: -1, 8: 1}[orientation]
    where = photosites(photograph.mosaic, photograph.size_px)
    np.testing.assert_array_equal(where, np.rot90(own, turns))
    measured = photograph.pixels[where] * 4000
    np.testing.assert_allclose(measured, np.rot90(codes, turns).ravel(), atol=0.2)


def test_raw_is_linear_camera_light(tmp_path: Path):
    pytest.importorskip("rawpy")
    mosaic = np.zeros((64, 96), np.uint16)
    mosaic[0::2, 0::2], mosaic[0::2, 1::2] = 1000, 2000
    mosaic[1::2, 0::2], mosaic[1::2, 1::2] = 2000, 500
    mosaic[:, 48:] *= 2
    write_dng(tmp_path / "a.dng", mosaic, 4000)
    photograph = read_photograph(tmp_path / "a.dng")
    assert photograph.pixels.shape == (64, 96, 3)
    np.testing.assert_allclose(photograph.pixels[32, 20], [0.25, 0.5, 0.125], atol=2e-4)
    np.testing.assert_allclose(photograph.pixels[32, 80], [0.5, 1.0, 0.25], atol=2e-4)
    assert (photograph.saturation, photograph.encoding) == (1.0, "linear")


def test_real_photographs(data_dir: Path):
    gopro = read_photograph(data_dir / "real" / "discorpy" / "GoPro8_dot_pattern.jpg")
    assert gopro.size_px == (4000, 3000)
    assert gopro.chroma_subsampled
    assert gopro.metadata["focal_length_mm"] == 3.0
    assert gopro.metadata["camera_model"] == "HERO8 Black"
    xray = read_photograph(data_dir / "real" / "discorpy" / "dot_pattern_04.jpg")
    assert xray.pixels.shape == (2672, 4008, 1)
    oracle = read_photograph(data_dir / "oracle" / "dg50" / "dots_f1p4_in.exr")
    assert oracle.pixels.shape == (1536, 2048, 3)
    assert oracle.metadata["f_number"] == 1.4
