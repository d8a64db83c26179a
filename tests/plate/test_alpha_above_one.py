"""Alpha above 1 counts as 1 where depth of field is put on, and takes no colour."""

import numpy as np
import pytest
from plate_makers import DATA, make_preset, write_plate

from lensfit.io.exr import read_exr
from lensfit.workflow.apply import apply


@pytest.mark.parametrize("alpha", [1.02, 3.0])
def test_colour_is_that_of_a_whole_pixel(tmp_path, alpha):
    size = DATA.height, DATA.width
    extra = {"Z": np.full(size, 5.0, np.float32)}
    found = {}
    for value in (1.0, alpha):
        plates = extra | {"A": np.full(size, value, np.float32)}
        plate = write_plate(tmp_path / "p.exr", extra=plates)
        done = apply(make_preset(), plate, tmp_path / f"{value}")
        assert any("has alpha up to 3" in note for note in done.notes) is (value == 3)
        (part,) = read_exr(done.written[0]).parts
        found[value] = np.stack([part.channels[c] for c in "RGBA"])
    np.testing.assert_array_equal(found[alpha], found[1.0])
