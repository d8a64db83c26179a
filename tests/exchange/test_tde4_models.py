"""3DEqualizer's models: the kit's own values, and inverses."""

import numpy as np
import pytest

from lensfit.exchange.tde4 import (
    ANAMORPHIC,
    KNOBS,
    RADIAL,
    RESCALED,
    Tde4Map,
)

RADIAL_VALUES = [0.11, 0.012, -0.021, -0.03, 0.004, 0.007, 25.0, 0.015]
ANAMORPHIC_VALUES = [0.09, 0.07, -0.02, 0.03, 0.015, -0.011, 0.006, 0.008]
ANAMORPHIC_VALUES += [-0.004, 0.005, 1.7, 1.04, 0.97]
VALUES = {
    RADIAL: RADIAL_VALUES,
    ANAMORPHIC: ANAMORPHIC_VALUES,
    RESCALED: [*ANAMORPHIC_VALUES, 1.3],
}
FILMBACK_MM = (24.0, 18.0)
CENTRE_MM = (0.3, 0.2)

# Unit coordinates (origin bottom left) before and after `undistort` of the Lens
# Distortion Plugin Kit 2.12, filmback 2.4 x 1.8 cm, lens centre offset 0.03, -0.02 cm.
KIT = {
    (RADIAL, 1.0): [
        (0.1, 0.2, 0.083019979815863731, 0.17732208232874147),
        (0.5, 0.5, 0.50000389154062075, 0.49983136113700927),
        (0.93, 0.08, 0.97710695724092822, 0.036776667299067145),
        (0.25, 0.97, 0.25097678773682286, 0.9661777466357544),
        (-0.05, 1.04, -0.061706173051794266, 1.0443051048869028),
    ],
    (ANAMORPHIC, 1.0): [
        (0.1, 0.2, 0.061911253466532999, 0.19426652466397909),
        (0.93, 0.08, 0.9752950747310617, 0.075278190015751451),
        (-0.05, 1.04, -0.15105435233822889, 1.0607228965255615),
    ],
    (ANAMORPHIC, 2.0): [
        (0.1, 0.2, 0.067128298999264424, 0.19480123916793754),
        (0.93, 0.08, 0.95172675034692999, 0.09434128839824979),
        (0.25, 0.97, 0.24099781170322201, 0.95696045515741135),
    ],
    (RESCALED, 2.0): [
        (0.1, 0.2, 0.06459552675130395, 0.19402328281659498),
        (0.5, 0.5, 0.49993552741330932, 0.49935414349916407),
        (0.93, 0.08, 0.94413354305207919, 0.097472162916035901),
        (-0.05, 1.04, -0.084737070944058884, 1.0208198357695442),
    ],
}


def make_map(model: str, pixel_aspect: float = 1.0) -> Tde4Map:
    knobs = dict(zip(KNOBS[model], VALUES[model], strict=True))
    return Tde4Map(model, knobs, FILMBACK_MM, CENTRE_MM, pixel_aspect)


@pytest.mark.parametrize(("model", "pixel_aspect"), list(KIT))
def test_values_are_the_kits(model: str, pixel_aspect: float):
    known = np.array(KIT[model, pixel_aspect])
    size = np.array([FILMBACK_MM[0], -FILMBACK_MM[1]])
    found = make_map(model, pixel_aspect).undistorted((known[:, :2] - 0.5) * size)
    assert np.abs(found / size + 0.5 - known[:, 2:]).max() < 1e-14


@pytest.mark.parametrize("model", list(KNOBS))
def test_distorting_undoes_undistorting(model: str):
    x, y = np.meshgrid(np.linspace(-12.6, 12.6, 15), np.linspace(-9.4, 9.4, 13))
    points = np.stack([x.ravel(), y.ravel()], -1)
    lens = make_map(model)
    assert np.abs(lens.distorted(lens.undistorted(points)) - points).max() < 1e-9


@pytest.mark.parametrize("model", list(KNOBS))
def test_a_node_as_it_comes_does_nothing(model: str):
    points = np.array([[3.0, -4.0], [11.0, 8.0]])
    lens = Tde4Map(model, {}, FILMBACK_MM, CENTRE_MM)
    assert np.allclose(lens.undistorted(points), points, rtol=0, atol=1e-14)


def test_where_the_polynomial_turns_over_there_is_no_inverse():
    lens = Tde4Map(RADIAL, {"Distortion_Degree_2": -0.5}, FILMBACK_MM)
    # r - r^3/2 never exceeds 0.55 half diagonals
    assert np.isnan(lens.distorted(np.array([[15.0 * 0.6, 0.0]]))).all()


def test_an_unknown_knob_is_a_programmers_mistake():
    with pytest.raises(ValueError, match="has no Squeeze_X"):
        Tde4Map(RADIAL, {"Squeeze_X": 1.0}, FILMBACK_MM)
