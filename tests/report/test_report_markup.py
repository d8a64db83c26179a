"""Numbers as a person writes them, and text that stays text."""

import math

import pytest

from lensfit.report.markup import (
    Markup,
    number,
    number_with_deviation,
    stated_value,
    tag,
)
from lensfit.report.plain_numbers import round_up
from lensfit.report.svg import ticks

THIN = "\u202f"


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.06239, "px", f"0.0624{THIN}px"),
        (-9.6123, "%", "−9.61%"),
        (6617, "", f"6{THIN}617"),
        (0.0, "mm", f"0{THIN}mm"),
        (-0.0, "mm", f"0{THIN}mm"),
        (1.04e-9, "px", f"1.04{THIN}×{THIN}10⁻⁹{THIN}px"),
        (math.inf, "m", f"∞{THIN}m"),
        (math.nan, "px", "–"),
        (None, "px", "–"),
    ],
)
def test_number(value, unit, text):
    assert number(value, unit) == text


@pytest.mark.parametrize(
    ("value", "deviation", "text"),
    [
        (51.2034, 0.0213, "51.203 ± 0.021"),
        (-4e-4, 3e-7, f"(−4.0000 ± 0.0030){THIN}×{THIN}10⁻⁴"),
        (0.0, 0.02, "0.000 ± 0.020"),
        (2.5, None, "2.500"),
        (2.5, 0.0, "2.500"),
        (None, 0.1, "–"),
    ],
)
def test_value_is_rounded_to_its_deviation(value, deviation, text):
    assert number_with_deviation(value, deviation) == text


def test_stated_values_gain_no_digits():
    assert stated_value(50.0, "mm") == f"50{THIN}mm"
    assert stated_value(1.4) == "1.4"
    assert stated_value(math.inf, "m") == f"∞{THIN}m"


def test_strings_are_escaped_and_markup_is_not():
    inner = tag("b", "<i>")
    assert inner == "<b>&lt;i&gt;</b>"
    assert tag("p", inner, None, ["a", 1], title='"') == (
        '<p title="&quot;"><b>&lt;i&gt;</b>a1</p>'
    )
    assert isinstance(tag("br"), Markup)


@pytest.mark.parametrize("span", [(0.0, 1.0), (-0.31, 0.02), (3.0, 1234.5), (0, 1e-7)])
def test_ticks_are_round_evenly_spaced_and_inside(span):
    values = ticks(*span)
    step = values[1] - values[0]
    assert 3 <= len(values) <= 8
    assert values.min() >= span[0] - 1e-9 * step
    assert values.max() <= span[1] + 1e-9 * step
    mantissa = step / 10 ** math.floor(math.log10(step) + 1e-9)
    assert min(abs(mantissa - m) for m in (1, 2, 5)) < 1e-6


def test_round_up_is_never_below_and_never_far_above():
    for value in (1e-6, 0.013, 0.2, 1.0, 7.0, 320.0):
        assert value * (1 - 1e-9) <= round_up(value) <= 2.5 * value * (1 + 1e-9)
