"""Other programs' models fitted to maps: exact where they can be, honest elsewhere."""

import numpy as np
import pytest

from lensfit.errors import ExchangeError
from lensfit.exchange.brown_conrady import D_U, U_D, BrownMap, fit_brown, fit_opencv
from lensfit.exchange.lensfun import (
    LensfunMap,
    fit_even_polynomial,
    fit_lensfun,
    fit_tca,
    tca_channel,
)
from lensfit.exchange.opencv import OpenCvMap
from lensfit.exchange.samples import (
    JUDGE_COUNT,
    ExchangeFrame,
    Samples,
    residual_of,
)
from lensfit.exchange.tde4 import ANAMORPHIC, KNOBS, RADIAL, RESCALED, Tde4Map, fit_tde4

FRAME = ExchangeFrame((2048, 1536), 24.0, 10.0)
CENTRE_MM = (0.3, 0.2)
ANAMORPHIC_VALUES = [0.09, 0.07, -0.02, 0.03, 0.015, -0.011, 0.006, 0.008]
ANAMORPHIC_VALUES += [-0.004, 0.005, 1.7, 1.04, 0.97]
TDE4 = {
    RADIAL: [0.11, 0.012, -0.021, -0.03, 0.004, 0.007, 25.0, 0.015],
    ANAMORPHIC: ANAMORPHIC_VALUES,
    RESCALED: [*ANAMORPHIC_VALUES, 1.3],
}


def closed_px(model, lens) -> float:
    """Worst distance between two models of the same lens over frame and overscan."""
    return residual_of(model, Samples.of(lens, FRAME, JUDGE_COUNT)).worst_px


@pytest.mark.parametrize("model", list(TDE4))
def test_a_3dequalizer_lens_comes_back(model: str):
    knobs = dict(zip(KNOBS[model], TDE4[model], strict=True))
    lens = Tde4Map(model, knobs, FRAME.area_mm, CENTRE_MM)
    found = fit_tde4(model, Samples.of(lens, FRAME), CENTRE_MM)
    assert closed_px(found, lens) < 1e-6


@pytest.mark.parametrize("model", [RADIAL, ANAMORPHIC, RESCALED])
def test_a_squeezed_lens_needs_no_more_than_a_squeeze(model: str):
    """Radial has no squeeze; its cylindric bending is one of area one."""
    knobs = {"Squeeze_X": 1.9**0.5, "Squeeze_Y": 1.9**-0.5, "Lens_Rotation": 1.5}
    lens = Tde4Map(ANAMORPHIC, knobs, FRAME.area_mm, CENTRE_MM)
    found = fit_tde4(model, Samples.of(lens, FRAME), CENTRE_MM)
    assert closed_px(found, lens) < 1e-6


def test_a_round_lens_is_not_rotated():
    lens = BrownMap(D_U, (-1e-3, 0.0, 2e-6), (), CENTRE_MM, 15.0)
    found = fit_tde4(ANAMORPHIC, Samples.of(lens, FRAME), CENTRE_MM)
    assert found.knobs["Lens_Rotation"] == 0.0


@pytest.mark.parametrize("model", [D_U, U_D])
@pytest.mark.parametrize(
    "radial", [(-1e-3, 0.0, 2e-6), (1.1e-3, 2e-3, -3e-6, 1e-6, 4e-9, -2e-9)]
)
def test_a_brown_conrady_lens_comes_back(model: str, radial):
    lens = BrownMap(model, radial, (1e-5, -2e-5), CENTRE_MM, 15.0)
    found = fit_brown(model, Samples.of(lens, FRAME), CENTRE_MM)
    assert closed_px(found, lens) < 1e-6


def test_a_denominator_stays_out_of_a_polynomial_lens():
    lens = BrownMap(D_U, (-1e-3, 0.0, 2e-6), (), CENTRE_MM, 15.0)
    found = fit_brown(D_U, Samples.of(lens, FRAME), CENTRE_MM)
    assert not any(found.radial[1::2])
    assert found.radial[:3] == pytest.approx(lens.radial, rel=1e-7, abs=1e-12)


def test_an_opencv_camera_comes_back():
    matrix = np.array([[2000.0, 0, 1030.0], [0, 2020.0, 760.0], [0, 0, 1]])
    coefficients = np.zeros(14)
    coefficients[:5] = -0.2, 0.1, 1e-3, -2e-3, -0.03
    lens = OpenCvMap(matrix, coefficients, FRAME.size_px, FRAME.pitch_mm)
    strain = -np.log(2000 / 2020)
    found = fit_opencv(
        Samples.of(lens, FRAME),
        lens.principal_distance_mm,
        lens.principal_point_mm,
        (strain, 0.0),
    )
    assert np.abs(found.matrix - matrix).max() < 1e-9
    assert found.coefficients == pytest.approx(coefficients, abs=1e-6)
    assert closed_px(found, lens) < 1e-6


@pytest.mark.parametrize(
    ("model", "terms"), [("poly5", (-0.02, 0.004)), ("ptlens", (0.01, -0.03, 0.015))]
)
def test_a_lensfun_lens_comes_back(model, terms):
    lens = LensfunMap(model, terms, 9.0, CENTRE_MM)
    found = fit_lensfun(Samples.of(lens, FRAME), CENTRE_MM)
    assert found.model == model
    assert found.terms == pytest.approx(terms, abs=1e-8)
    assert closed_px(found, lens) < 1e-6


def test_lateral_colour_and_vignetting_come_back():
    green = FRAME.grid_mm(21)
    terms = (1.0003, -1e-4, 2e-4)
    red = tca_channel(green, terms, 9.0, CENTRE_MM)
    assert fit_tca(green, red, 9.0, CENTRE_MM) == pytest.approx(terms, abs=1e-12)
    radius = np.linspace(0, 1.1, 50)
    light = 1 - 0.5 * radius**2 + 0.1 * radius**4 - 0.05 * radius**6
    found, worst = fit_even_polynomial(radius, light)
    assert found == pytest.approx((-0.5, 0.1, -0.05), abs=1e-10)
    assert worst < 1e-12


def test_the_residual_is_a_distance_on_the_photograph():
    """A lens moved by three pixels right and four down is five pixels off."""
    lens = BrownMap(D_U, (-1e-3, 0.0, 2e-6), (), (0.0, 0.0), 15.0)

    class Moved:
        def distorted(self, undistorted_mm):
            return lens.distorted(undistorted_mm) + FRAME.pitch_mm * np.array([3, 4])

        def undistorted(self, distorted_mm):
            return lens.undistorted(distorted_mm)

    found = residual_of(Moved(), Samples.of(lens, FRAME))
    assert found.rms_px == pytest.approx(5.0)
    assert found.worst_px == pytest.approx(5.0)


def test_a_model_that_turns_over_in_the_frame_is_refused():
    lens = BrownMap(D_U, (0.0,), (), (0.0, 0.0), 15.0)
    folding = BrownMap(U_D, (-4e-3,), (), (0.0, 0.0), 15.0)
    with pytest.raises(ExchangeError, match="turns over"):
        residual_of(folding, Samples.of(lens, FRAME))
    with pytest.raises(ExchangeError, match="no undistorted picture"):
        Samples.of(folding, FRAME)
