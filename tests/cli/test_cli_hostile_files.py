"""Files that would be misread, fill memory or change places: refused in one line."""

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
import tifffile
from command_line import run
from PIL import Image
from plate_makers import make_preset

from lensfit.coords import Window
from lensfit.io import decoding
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.preset.schema import LensName
from lensfit.preset.store import save_preset


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
        assert file.pages.first.photometric == tifffile.PHOTOMETRIC.YCBCR
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
    monkeypatch.setattr(decoding, "available_bytes", lambda: 16 << 20)
    refused(run("inspect", path), f"a{suffix}", "GiB of memory", "0.0156 GiB are")


@pytest.mark.parametrize("command", ["apply", "undistort"])
def test_a_plate_that_would_fill_the_memory_is_not_decoded(
    tmp_path, monkeypatch, command
):
    """Eight megabytes of samples, and as many again for each twelfth of the work."""
    preset = named(tmp_path, "Lens")
    plate = black(tmp_path / "a.exr")
    state = ["--focal-length-mm", "35", "--f-number", "2.8", "--out", tmp_path / "out"]
    state += ["--sensor-width-mm", "36", "--focus-distance-mm", "2000"]
    state += ["--no-defocus"] if command == "apply" else []
    monkeypatch.setattr(decoding, "available_bytes", lambda: 40 << 20)
    done = run(command, preset, plate, *state)
    assert "GiB of memory when decoded, and 0.0391 GiB are available" in done.stderr
    assert done.exit_code == 1
    monkeypatch.setattr(decoding, "available_bytes", lambda: 120 << 20)
    assert run(command, preset, plate, *state).exit_code == 0


def test_many_black_channels_are_no_bomb(tmp_path):
    """They compress a thousand times, and are read all the same."""
    plane, window = np.zeros((1080, 1920), np.float16), Window.of_size(1920, 1080)
    names = [*"RGB", *(f"matte{n}.x" for n in range(200))]
    part = ExrPart(dict.fromkeys(names, plane), window, window)
    write_exr(tmp_path / "a.exr", ExrImage((part,)))
    assert run("inspect", tmp_path / "a.exr").exit_code == 0


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


CAMERA = {"lens/focal": 35.0, "lens/fstop": 2.8, "lens/focus": 2.0}


def deep_plate(path: Path, header: dict, display: Window | None = None) -> Path:
    """A small plate with depth."""
    window = Window.of_size(96, 64)
    channels = dict.fromkeys("RGBZ", np.full((64, 96), 3.0, np.float32))
    header = {**CAMERA, "lens/aperture": 36.0, **header}
    part = ExrPart(channels, window, display or window, header)
    write_exr(path, ExrImage((part,)))
    return path


def preset_with(tmp_path: Path, change) -> Path:
    save_preset(make_preset(), tmp_path / "preset.json")
    found = json.loads((tmp_path / "preset.json").read_text())
    change(found["entries"][0])
    (tmp_path / "preset.json").write_text(json.dumps(found))
    return tmp_path / "preset.json"


def test_a_double_of_a_header_is_a_number(tmp_path):
    """As other writers than the OpenEXR binding store numbers: 8 bytes, one value."""
    plate = deep_plate(tmp_path / "a.exr", {})
    whole = plate.read_bytes()
    old = b"lens/focal\0float\0" + struct.pack("<if", 4, 35.0)
    new = b"lens/focal\0double\0" + struct.pack("<id", 8, 35.0)
    assert whole.count(old) == 1
    moved = bytearray(whole.replace(old, new))
    # The table of chunks follows the header and counts from the start of the file.
    first = min(
        at
        for at in range(len(whole) - 8)
        if struct.unpack_from("<Q", whole, at)[0] == at + 8 * _chunks(whole, at)
    )
    for index in range(_chunks(whole, first)):
        at = first + 8 * index
        value = struct.unpack_from("<Q", whole, at)[0] + len(new) - len(old)
        struct.pack_into("<Q", moved, at + len(new) - len(old), value)
    plate.write_bytes(moved)
    done = run("inspect", plate, "--json")
    assert done.exit_code == 0, done.output
    assert '"focal_length_mm"' in done.stdout
    assert "35.0" in done.stdout
    preset = preset_with(tmp_path, lambda entry: None)
    applied = run("apply", preset, plate, "--no-defocus", "--out", tmp_path / "out")
    assert applied.exit_code == 0, applied.output


def _chunks(whole: bytes, at: int) -> int:
    """Entries of a table of chunks at a place: 64 lines, sixteen to a chunk."""
    return 4


@pytest.mark.parametrize("key", ["depth/kind", "depth/unit"])
def test_a_matrix_in_place_of_a_word_is_no_word(tmp_path, key):
    plate = deep_plate(tmp_path / "a.exr", {key: np.eye(3, dtype=np.float32)})
    preset = preset_with(tmp_path, lambda entry: None)
    done = run("apply", preset, plate, "--out", tmp_path / "out")
    refused(done, "a.exr", f"{key} of the header is no", "a list or matrix", "--depth-")


def test_a_frame_beyond_what_is_rendered_is_said_to_be_large_not_damaged(tmp_path):
    preset = preset_with(tmp_path, lambda entry: None)
    wide = deep_plate(tmp_path / "a.exr", {}, Window(0, 0, 98_999, 63))
    done = run("apply", preset, wide, "--no-defocus", "--out", tmp_path / "out")
    refused(done, "a.exr", "99000 x 64 pixels", "32766 on a side is the most")
    huge = deep_plate(tmp_path / "b.exr", {}, Window(0, 0, 98_999, 9_999))
    done = run("inspect", huge)
    refused(done, "b.exr", "display window of 99000 x 10000", "crop it")
    assert "damaged" not in done.stderr


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda e: e["lateral_colour"]["r"].update(decentering=[1e-4] * 6), "r.decent"),
        (lambda e: e["lateral_colour"]["b"].update(strain=[1e-4]), "b.strain"),
        (lambda e: e["fall_off"][0].update(g=[1e300, 1e300]), "fall_off[0].g"),
        (lambda e: e["fall_off"][0].update(f_number=1e300), "fall_off[0].f_number"),
        (lambda e: e["projection"].update(principal_distance_mm=1e300), "no length"),
    ],
)
def test_coefficients_that_no_lens_has_are_named(tmp_path, change, said):
    preset = preset_with(tmp_path, change)
    refused(run("preset", "validate", preset), said)
    refused(run("stmap", preset, "--out", tmp_path / "maps"), said)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_exists_and_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "a.exr")
    preset = preset_with(tmp_path, lambda entry: None)
    for words in (["inspect"], ["apply", preset, "--out", tmp_path / "out"]):
        command, *options = words
        done = run(command, *options[:1], tmp_path / "a.exr", *options[1:])
        refused(done, "a.exr", "is no ordinary file")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_a_pipe_in_place_of_a_map_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "map.exr")
    preset = preset_with(tmp_path, lambda entry: None)
    plate = deep_plate(tmp_path / "a.exr", {})
    words = ["apply", preset, plate, "--out", tmp_path / "out", "--stmap"]
    refused(run(*words, tmp_path / "map.exr"), "map.exr", "is no ordinary file")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_device_is_said_in_one_line(tmp_path):
    preset = preset_with(tmp_path, lambda entry: None)
    script = "from lensfit.cli.main import main; main()"
    words = [sys.executable, "-c", script, "preset", "validate", str(preset)]
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert "standard output cannot be written (No space left on device)" in line
