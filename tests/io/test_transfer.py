"""Transfer functions invert, rise, and hit the grey cards their makers publish."""

import numpy as np
import pytest

from lensfit.errors import ImageError
from lensfit.io.transfer import ENCODINGS, decode, encode

every_encoding = pytest.mark.parametrize("encoding", ENCODINGS)


@every_encoding
def test_codes_survive_a_round_trip(encoding: str):
    codes = np.linspace(0, 1, 4097)
    # Makers round their constants to six or seven digits, which leaves a step of
    # about 1e-6 where a toe meets its log.
    np.testing.assert_allclose(
        encode(decode(codes, encoding), encoding), codes, atol=3e-6
    )


@every_encoding
def test_light_rises_with_code_and_crosses_black(encoding: str):
    light = decode(np.linspace(0, 1, 65536), encoding)
    assert (np.diff(light) > 0).all()
    assert light[0] <= 0 < light[-1]


@every_encoding
def test_noise_below_black_is_not_clipped(encoding: str):
    light = np.array([-0.004, -0.002, 0.0, 0.002])
    back = decode(encode(light, encoding), encoding)
    np.testing.assert_allclose(back, light, atol=1e-6)


@pytest.mark.parametrize(
    ("encoding", "light", "code_10_bit"),
    [
        ("logc3", 0.18, 400),  # ARRI 2012: 18 % grey at code 400 at every EI
        ("logc4", 0.18, 284.8),  # ARRI 2022: 27.8 %
        ("slog3", 0.0, 95),  # Sony: 0, 18, 90 % at 95, 420, 598
        ("slog3", 0.18, 420),
        ("slog3", 0.90, 598),
        ("redlog3g10", 0.18, 341),  # RED: mid grey at one third
        ("redlog3g10", 184.32, 1023),  # RED: ten stops above grey at full code
        ("canonlog3", 0.0, 128),  # Canon: black 128, grey 351
        ("canonlog3", 0.18, 351),
        ("cineon", 0.0, 95),  # Kodak: black 95, white 685
        ("cineon", 1.0, 685),
        ("rec709", 0.18, 418.3),  # BT.709: 40.9 %
        ("srgb", 0.18, 472.1),  # IEC: 46.1 %
        ("gamma2.2", 0.5**2.2, 511.5),
        ("gamma2.4", 0.5**2.4, 511.5),
        ("linear", 0.18, 184.14),
    ],
)
def test_published_reference_points(encoding: str, light: float, code_10_bit: float):
    code = float(encode(np.array(light), encoding)) * 1023
    assert code == pytest.approx(code_10_bit, abs=0.5)


@pytest.mark.parametrize(
    ("encoding", "light", "code"),
    [
        # colour-science 0.4, tests of the functions of the same names.
        ("logc3", 1.0, 0.570631558120417),
        ("logc4", 0.0, 0.092864125122190),
        ("logc4", 0.18, 0.278395836548265),
        ("logc4", 1.0, 0.427519364835306),
        ("slog3", 0.18, 0.410557184750733),
        ("redlog3g10", 0.0, 0.091551487714745),
        ("cineon", 0.18, 0.457319613085418),
    ],
)
def test_agrees_with_another_implementation(encoding: str, light: float, code: float):
    assert float(encode(np.array(light), encoding)) == pytest.approx(code, abs=1e-8)
    assert float(decode(np.array(code), encoding)) == pytest.approx(light, abs=1e-8)


def test_unknown_encoding_lists_the_known_ones():
    with pytest.raises(ImageError, match="use one of linear, srgb"):
        decode(np.zeros(1), "logz")
