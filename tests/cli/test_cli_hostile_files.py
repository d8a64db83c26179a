"""Files that would be misread, fill memory or change places: refused in one line."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
import tifffile
from PIL import Image
from plate_makers import make_preset
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.coords import Window
from lensfit.io import decoded_size
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.preset.schema import LensName
from lensfit.preset.store import save_preset


def run(*words: object):
    return CliRunner().invoke(app, [str(word) for word in words])


def refused(done, *parts: str) -> None:
    assert done.exit_code == 1
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("lensfit: error: ")
    for part in parts:
        assert part in line


@pytest.mark.parametrize(
    ("photometric", "channels", "said"),
    [("separated", 4, "CMYK"), ("cielab", 3, "CIE L*a*b*"), ("ycbcr", 3, "YCbCr")],
)
def test_samples_that_are_no_rgb_are_not_taken_for_it(
    tmp_path, photometric, channels, said
):
    codes = np.full((24, 32, channels), 90, np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", codes, photometric=photometric)
    refused(run("inspect", tmp_path / "a.tif"), f"has {said} colours", "grey or RGB")


def test_jpeg_within_tiff_is_decoded_to_rgb(tmp_path):
    """Stored as YCbCr, and returned as the colours that were put in."""
    codes = np.zeros((32, 32, 3), np.uint8)
    codes[..., 0], codes[..., 2] = 200, 40
    stored = Image.fromarray(codes).convert("YCbCr")
    stored.save(tmp_path / "a.tif", compression="jpeg", quality=95)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.pages[0].photometric == tifffile.PHOTOMETRIC.YCBCR
    from lensfit.io.raster import read_raster

    read = read_raster((tmp_path / "a.tif").read_bytes()).codes
    assert np.abs(read.astype(int) - codes).max() < 6
    assert run("inspect", tmp_path / "a.tif").exit_code == 0


def black(path: Path) -> Path:
    """A megapixel of nothing in a few kilobytes."""
    if path.suffix == ".exr":
        plane, window = np.zeros((1024, 1024), np.float16), Window.of_size(1024, 1024)
        channels = {n: plane for n in ("R", "G", "B", "A")}
        write_exr(path, ExrImage((ExrPart(channels, window, window),)))
    elif path.suffix == ".png":
        Image.new("RGB", (1024, 1024)).save(path)
    else:
        codes = np.zeros((1024, 1024, 3), np.uint8)
        tifffile.imwrite(path, codes, compression="zlib", photometric="rgb")
    return path


@pytest.mark.parametrize("suffix", [".exr", ".png", ".tif"])
def test_a_small_file_that_claims_a_huge_picture_is_not_decoded(
    tmp_path, monkeypatch, suffix
):
    path = black(tmp_path / f"a{suffix}")
    assert run("inspect", path).exit_code == 0
    # As a file of 300 times as many pixels would be judged.
    monkeypatch.setattr(decoded_size, "ALWAYS_SAMPLES", 1 << 20)
    refused(run("inspect", path), "million samples", "more than any photograph")
    noise = np.random.default_rng(1).integers(0, 255, (1024, 1024, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png")
    assert run("inspect", tmp_path / "noise.png").exit_code == 0


def named(folder: Path, name: str, serial: str | None = None) -> Path:
    preset = msgspec.structs.replace(make_preset(), lens=LensName(name, serial))
    save_preset(preset, folder / "preset.json")
    return folder / "preset.json"


def kept(folder: Path, library: Path, *name: str):
    path = named(folder, *name)
    words = ["preset", "save", path, "--library", library, "--who", "me", "--json"]
    return run(*words)


@pytest.mark.parametrize(
    "other", ["Cooke S4 i 50", "Cooke S4-i (50)", "Cooke S4/i: 50", "Cooke S4/i_50"]
)
def test_names_that_differ_in_signs_are_no_versions_of_one_lens(tmp_path, other):
    library = tmp_path / "show"
    library.mkdir()
    assert kept(tmp_path, library, "Cooke S4/i 50").exit_code == 0
    done = kept(tmp_path, library, other)
    refused(done, f'"{other}"', '"Cooke S4/i 50"', "lens.name", "lens.serial")
    again = kept(tmp_path, library, "cooke  S4/i 50")
    assert json.loads(again.stdout)["version"] == "v002"
    with_serial = kept(tmp_path, library, other, "123")
    assert json.loads(with_serial.stdout)["version"] == "v001"


def test_a_level_around_has_its_names_too(tmp_path):
    show, shot = tmp_path / "show", tmp_path / "show" / "sh010"
    shot.mkdir(parents=True)
    assert run("preset", "project", show, "--who", "me").exit_code == 0
    assert kept(tmp_path, show, "Cooke S4/i 50").exit_code == 0
    refused(kept(tmp_path, shot, "Cooke S4 i 50"), '"Cooke S4/i 50"')
    assert kept(tmp_path, shot, "Cooke S4/i 50").exit_code == 0


def test_names_without_letters_are_lenses_of_their_own(tmp_path):
    library = tmp_path / "show"
    library.mkdir()
    lenses = [json.loads(kept(tmp_path, library, name).stdout) for name in ("?", "***")]
    assert len({one["lens"] for one in lenses}) == 2
    for name in ("?", "***"):
        done = run("preset", "show", name, "--library", library)
        assert done.exit_code == 0, done.stderr
