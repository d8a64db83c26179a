"""Deep pictures: samples as they were written; what is cut short is refused."""

import numpy as np
import OpenEXR
import pytest
from deep_files import write_deep

from lensfit.coords import Window
from lensfit.errors import ImageError, OutputError
from lensfit.io import exr_deep
from lensfit.io.exr import ExrPart, read_exr
from lensfit.io.exr_deep import DeepPart, is_deep, read_deep


def test_samples_come_back_pixel_after_pixel(tmp_path):
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 4, (5, 7))
    samples = {n: rng.random(counts.sum()).astype(np.float32) for n in "RGBAZ"}
    samples["A"] = samples["A"].astype(np.float16)
    path = write_deep(tmp_path / "deep.exr", counts, samples, {"owner": "me"})
    assert is_deep(path)
    part = read_deep(path)
    assert np.array_equal(part.counts, counts)
    for name, values in samples.items():
        assert part.samples[name].tobytes() == values.tobytes()
    assert part.flat.attributes["owner"] == "me"


def test_flat_readers_say_what_it_is(tmp_path):
    path = write_deep(tmp_path / "d.exr", np.ones((2, 2), int), {"Z": np.ones(4, "f4")})
    with pytest.raises(ImageError, match="deep"):
        read_exr(path)


def test_flat_files_are_not_deep(tmp_path):
    plane = np.ones((2, 2), np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": plane}).write(
        str(tmp_path / "flat.exr")
    )
    assert not is_deep(tmp_path / "flat.exr")
    with pytest.raises(ImageError, match="no deep"):
        read_deep(tmp_path / "flat.exr")


def test_truncated_files_are_refused(tmp_path):
    counts = np.full((40, 30), 3)
    values = np.random.default_rng(1).random(counts.sum()).astype(np.float32)
    path = write_deep(tmp_path / "deep.exr", counts, {"Z": values})
    content = path.read_bytes()
    for share in (0.3, 0.8, 0.99):
        path.write_bytes(content[: int(share * len(content))])
        with pytest.raises(ImageError, match="damaged"):
            read_deep(path)


def deep_part(counts, attributes=None) -> DeepPart:
    """With overscan: the data window begins left of and above the display window."""
    rng = np.random.default_rng(2)
    height, width = counts.shape
    data = Window(-1, -2, width - 2, height - 3)
    flat = ExrPart({}, data, Window.of_size(width - 2, height - 4), attributes or {})
    samples = {n: rng.random(counts.sum()).astype(np.float16) for n in "RGBA"}
    samples["Z"] = rng.uniform(100, 9000, counts.sum()).astype(np.float32)
    return DeepPart(flat, counts, samples)


def test_what_is_written_comes_back_bit_for_bit(tmp_path):
    counts = np.random.default_rng(1).integers(0, 5, (6, 8))
    part = deep_part(counts, {"lens/fstop": 2.0, "owner": "me"})
    exr_deep.write_deep(tmp_path / "deep.exr", part)
    back = read_deep(tmp_path / "deep.exr")
    np.testing.assert_array_equal(back.counts, counts)
    for name, values in part.samples.items():
        assert back.samples[name].tobytes() == values.tobytes()
        assert back.samples[name].dtype == values.dtype
    assert back.data_window == part.data_window
    assert back.flat.display_window == part.flat.display_window
    assert back.flat.attributes["lens/fstop"] == 2.0


def test_a_deep_picture_that_cannot_be_written_leaves_nothing(tmp_path):
    part = deep_part(np.ones((6, 8), int), {"odd": {"a": 1}})
    with pytest.raises(OutputError, match="odd"):
        exr_deep.write_deep(tmp_path / "deep.exr", part)
    assert list(tmp_path.iterdir()) == []
