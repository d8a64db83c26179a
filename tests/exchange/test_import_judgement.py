"""What an import says of a map that lensfit's terms cannot follow."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import ForeignLens, ForeignState
from lensfit.exchange.imports import Imported, preset_of_foreign, refuse_failed_fit
from lensfit.exchange.samples import Residual

SIZE_PX = (320, 240)
SENSOR_MM = (24.0, 18.0)
PITCH_MM = SENSOR_MM[0] / SIZE_PX[0]
WAVE_PX = 41.0


@dataclass(frozen=True)
class Ripples:
    """Waves across the picture, far finer than any lens bends; slope 1 on the axis."""

    height_px: float

    def undistorted(self, distorted_mm: np.ndarray) -> np.ndarray:
        phase = distorted_mm[:, 0] * 2 * np.pi / (WAVE_PX * PITCH_MM)
        moved = self.height_px * PITCH_MM * (np.cos(phase) - 1)
        return distorted_mm + np.stack([moved, np.zeros(len(moved))], -1)

    def distorted(self, undistorted_mm: np.ndarray) -> np.ndarray:
        found = undistorted_mm
        for _ in range(200):
            found = found + undistorted_mm - self.undistorted(found)
        return found


def imported(folder: Path, height_px: float) -> Imported:
    path = folder / "ripples"
    path.write_text("a map")
    state = ForeignState(Ripples(height_px), 50.0, (0.0, 0.0), 50.0)
    lens = ForeignLens("a test", "Ripples", SENSOR_MM, SIZE_PX, (state,))
    return preset_of_foreign(lens, path)


def test_what_no_term_follows_is_refused_in_one_sentence(tmp_path: Path):
    with pytest.raises(ExchangeError, match=r"ripples: .* cannot follow .* at 50 mm"):
        imported(tmp_path, 5.0)


def test_more_than_half_a_pixel_is_said(tmp_path: Path):
    found = imported(tmp_path, 0.6)
    assert 0.5 < found.fits[0].distortion.worst_px < 3
    (note,) = [n for n in found.notes if "differs visibly" in n]
    assert "distortion at 50 mm" in note


def test_less_than_half_a_pixel_is_not_said(tmp_path: Path):
    found = imported(tmp_path, 0.05)
    assert 0.01 < found.fits[0].distortion.worst_px < 0.5
    assert not any("differs visibly" in note for note in found.notes)


@pytest.mark.parametrize("left", [Residual(27.0, 77.0), Residual(np.nan, np.nan)])
def test_a_lens_left_without_its_distortion_is_refused(left: Residual):
    with pytest.raises(ExchangeError, match="rms 27 px"):
        refuse_failed_fit("51 mm", left, Residual(27.0, 77.0), Path("lens.xml"))


@pytest.mark.parametrize("left", [Residual(2.5, 2.9), Residual(13.0, 77.0)])
def test_a_lens_that_is_near_or_explained_is_not_refused(left: Residual):
    refuse_failed_fit("51 mm", left, Residual(27.0, 77.0), Path("lens.xml"))
