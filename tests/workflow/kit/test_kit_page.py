"""The table and the page of a kit, from facts that are known."""

import math
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Browser

from lensfit.workflow.kit.kit_file import FocusMark, KitLens
from lensfit.workflow.kit.kit_page import kit_page, summary
from lensfit.workflow.kit.lens_record import (
    breathing_percent,
    focus_scale,
    measured_distance_mm,
    width_px,
)
from lensfit.workflow.kit.match import matches


def lens_row(folder: str, focal_mm: float, distortion: float, **changes) -> dict:
    """A lens as kit.json has it."""
    headline = "Ready for measurement, match-moving and CG: held out within 0.03 px."
    row = {
        "folder": folder,
        "name": folder.title(),
        "serial": "7",
        "lens_set": "Stage 4",
        "focal_lengths_mm": [focal_mm],
        "state": "done",
        "failed": None,
        "report": f"{folder}/report.html",
        "verdict": {
            "level": "measurement",
            "headline": headline,
            "accuracy_px": 0.031,
            "tone": "good",
            "remedy": "",
        },
        "focal_lengths": [
            {
                "focal_length_mm": focal_mm,
                "fitted_focal_length_mm": 1.004 * focal_mm,
                "breathing_percent": 1.2,
                "distortion_percent": distortion,
                "lateral_colour_px": 0.4,
                "fall_off": [
                    {"f_number": 1.4, "corner_stops": 1.6},
                    {"f_number": 5.6, "corner_stops": 0.7},
                ],
            }
        ],
        "focus_scale": [
            {
                "focal_length_mm": focal_mm,
                "engraved": "4'11\"",
                "engraved_mm": 1498.6,
                "measured_mm": 1580.0,
                "standard_deviation_mm": 9.0,
                "off_mm": -0.03,
                "off_deviation_mm": 0.004,
            }
        ],
        "blur_widths": [
            {
                "focal_length_mm": focal_mm,
                "f_number": 1.4,
                "focus_distance_mm": 1500.0,
                "centre_px": 2.1,
                "middle_px": 3.0,
                "edge_px": 5.2,
            }
        ],
    }
    return row | changes


def kit_of(*lenses: dict) -> dict:
    return {
        "schema": "lensfit.kit.1",
        "name": "Stage 4 <primes>",
        "camera": {"model": "ALEXA 35"},
        "lenses": list(lenses),
        "sets": matches(list(lenses)),
    }


FAILED = lens_row(
    "portrait 85", 85.0, 0.1, state="failed", failed="v03.exr: no dot grid is found",
    report=None, verdict=None, focal_lengths=[], focus_scale=[], blur_widths=[],
)  # fmt: skip
SOFT = lens_row(
    "wide 18", 18.0, -3.2,
    verdict={
        "level": "look",
        "headline": "Good for soft CG at most: near and far are probably swapped",
        "accuracy_px": 0.9,
        "tone": "caution",
        "remedy": "check focus_distance_mm of near and far views",
    },
)  # fmt: skip
KIT = kit_of(
    SOFT, lens_row("wide 25", 25.0, -1.1), lens_row("normal 50", 50.0, -1.0), FAILED
)


def test_a_mark_that_is_right_measures_as_engraved():
    for engraved in (600.0, 1500.0, 1e5, math.inf):
        assert measured_distance_mm(50.0, engraved, 0.0) == pytest.approx(engraved)


def test_the_image_moves_back_for_what_is_nearer():
    """dv/dD of a thin lens is -m^2 / (1 - m^2), with the distance from the sensor."""
    focal, engraved, off = 50.0, 1500.0, 1e-4
    s = (engraved + math.sqrt(engraved**2 - 4 * focal * engraved)) / 2
    m = focal / (s - focal)
    moved = measured_distance_mm(focal, engraved, off) - engraved
    assert moved == pytest.approx(-off * (1 - m**2) / m**2, rel=1e-3)
    assert measured_distance_mm(focal, 1e6, -1.0) == math.inf


def test_a_scale_that_is_off_is_measured_from_its_photographs():
    """Two photographs of one mark count by their deviations."""
    lens = KitLens("A", [50.0], [1.4], [FocusMark("1.5 m", 1500.0)])

    def group(off_mm: float, deviation_mm: float) -> dict:
        v = {d: d - (d + math.sqrt(d * d - 200 * d)) / 2 for d in (1500.0, 2000.0)}
        value = v[1500.0] - v[2000.0] + off_mm
        told = {"defocus_mm": value, "standard_deviation_mm": deviation_mm}
        return {
            "focus_distance_mm": 1500.0,
            "target_distance_mm": 2000.0,
            "from_stated": told,
        }

    blur = {"focal_length_mm": 50.0, "defocus": [group(0.03, 0.01), group(0.0, 0.02)]}
    (row,) = focus_scale(lens, {"blur": [blur]})
    assert row["off_mm"] == pytest.approx(0.8 * 0.03)
    assert row["off_deviation_mm"] == pytest.approx(1 / math.sqrt(1e4 + 2.5e3))
    assert row["measured_mm"] == measured_distance_mm(50.0, 1500.0, row["off_mm"])
    squeezed = KitLens("A", [50.0], [1.4], lens.focus_marks, anamorphic_squeeze=2.0)
    assert focus_scale(squeezed, {"blur": [blur]}) == []


def test_breathing_is_near_over_far():
    near = {"focus_distance_mm": 800.0, "principal_distance_mm": 51.0}
    far = {"focus_distance_mm": "inf", "principal_distance_mm": 50.0}
    assert breathing_percent([far, near]) == pytest.approx(2.0)
    assert breathing_percent([near]) is None


@pytest.mark.parametrize("diameter", [4.0, 9.0])
def test_a_disc_is_as_wide_as_it_is(diameter: float):
    y, x = np.mgrid[-24:25:0.1, -24:25:0.1]
    disc = (np.hypot(x, y) < diameter / 2).astype(float)
    assert 0.1 * width_px(disc) == pytest.approx(diameter, rel=0.01)


def test_the_lens_that_does_not_match_is_named():
    (found,) = KIT["sets"]
    figures = {one["quantity"]: one for one in found["figures"]}
    odd = figures["distortion"]["odd"]
    assert [one["folder"] for one in odd] == ["wide 18"]
    assert figures["distortion"]["median"] == -1.1
    assert figures["distortion"]["spread"] == pytest.approx(2.2)
    assert figures["breathing"]["odd"] == []
    assert matches([lens_row("a", 25.0, 0.0)]) == []


def test_the_headline_names_the_lenses_to_look_at():
    assert summary(KIT["lenses"]) == (
        "2 of 4 lenses are good for match-moving or better; look at Wide 18 s/n 7 and "
        "Portrait 85 s/n 7."
    )
    waiting = lens_row("a", 25.0, 0.0, state="waiting", verdict=None)
    assert summary([waiting]).endswith("; 1 not calibrated yet.")


def test_names_of_others_are_text():
    assert "Stage 4 &lt;primes&gt;" in kit_page(KIT)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_the_page_in_a_browser(tmp_path: Path):
    page = tmp_path / "kit.html"
    page.write_text(kit_page(KIT), encoding="utf-8")
    with Browser(tmp_path / "profile") as browser:
        for width in (390, 1400):
            browser.open(page, width, 1000)
            assert browser.run("document.documentElement.scrollWidth") <= width
        sections = browser.run(
            "[...document.querySelectorAll('section[id]')].map((one) => one.id)"
        )
        assert sections == ["again", "lenses", "match", "scale"]
        links = browser.run(
            "[...document.querySelectorAll('td.lens a')].map((a) =>"
            " a.getAttribute('href'))"
        )
        assert links == [
            f"{n}/report.html" for n in ("wide 18", "wide 25", "normal 50")
        ]
        odd = browser.run("document.querySelectorAll('#match .odd').length")
        assert odd == 1
        assert set(browser.requests) == {page.as_uri()}
        assert browser.complaints == []
