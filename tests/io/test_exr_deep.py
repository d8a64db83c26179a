"""Deep pictures: samples as they were written; what is cut short is refused."""

import numpy as np
import OpenEXR
import pytest
from deep_files import write_deep

from lensfit.errors import ImageError
from lensfit.io.exr import read_exr
from lensfit.io.exr_deep import is_deep, read_deep


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
