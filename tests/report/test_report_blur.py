"""Blur in the report: kernels of the right size, dots beside their model, a table."""

import copy
import math
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from report_samples import barrel_report, draw_overlays

from lensfit.preset.blocks import Blur, Camera, Distortion, Projection, Pupil
from lensfit.preset.entry import Entry, Quality
from lensfit.preset.schema import LensName, Preset, Provenance
from lensfit.preset.store import load_preset, save_preset
from lensfit.report.kernels import (
    kernel_sheets,
    kernel_states,
    reach_share,
)
from lensfit.report.pictures import dot_tiles, sheet_of, with_bar, write_dot_pictures
from lensfit.report.plain_numbers import distance_of, plain, plain_distance
from lensfit.report.report_page import write_report


def entry_of(focus_distance_mm: float, radial: tuple[float, ...]) -> Entry:
    """A 50 mm f/1.4 without aberrations."""
    blur = Blur(
        aberrations=(),
        field_radius_mm=15.0,
        reference_sine=0.35,
        exit_pupil_distance_mm=51.3,
        pupil_magnification=1.0,
        reference_distance_mm=2000.0,
        focus_offset_mm=0.0,
        pupil=Pupil(),
        stops=(),
        band_centres_nm=(610.0, 540.0, 460.0),
        band_widths_nm=(26.0, 26.0, 26.0),
        round_f_number=1.4,
    )
    return Entry(
        focal_length_mm=50.0,
        focus_distance_mm=focus_distance_mm,
        projection=Projection(51.3, (0.0, 0.0), 51.3),
        distortion=Distortion("rectilinear", 15.0, 1.0, (-0.8, -0.6, 0.8, 0.6), radial),
        lateral_colour=None,
        fall_off=(),
        terms=(),
        covariance=None,
        quality=Quality(0.02, 0.02, 100, 100, 1, None, None),
        blur=blur,
    )


def saved(folder: Path, *entries: Entry) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    made = Provenance("2025-01-31T12:00:00+00:00", "0.1.0", {}, ())
    camera = Camera(None, 24.0, 18.0, 2000, 1500)
    path = folder / "preset.json"
    preset = Preset(
        lens=LensName("plain"), camera=camera, entries=entries, provenance=made
    )
    save_preset(preset, path)
    return path


def report_of(*states: tuple[float | str, float, float | None]) -> dict:
    """A report whose takes have these focus distances, f-numbers, chart distances."""
    report = barrel_report(len(states))
    for take, (focus, f_number, target) in zip(report["takes"], states, strict=True):
        take |= {"focus_distance_mm": focus, "f_number": f_number}
        take["target_distance_mm"] = target
    return report


def test_a_disc_of_blur_halves_when_the_aperture_does(tmp_path):
    """Defocus (1.29 mm) over f-number: 77 pixels of 12 um at f/1.4."""
    preset = saved(tmp_path, entry_of(4000.0, ()))
    report = report_of((4000.0, 1.4, 1000.0), (4000.0, 2.8, 1000.0))
    wide, narrow = kernel_sheets(report, preset)
    assert wide.width_px / narrow.width_px == pytest.approx(2.0, rel=0.1)
    moved_mm = 1 / (1 / 50 - 1 / 950) - 1 / (1 / 50 - 1 / 3950)
    disc_px = moved_mm / 1.4 / 0.012
    assert disc_px < wide.width_px < 2 * disc_px
    assert narrow.width_px / 8 < narrow.bar_px < narrow.width_px


@pytest.mark.slow
def test_padding_for_one_program_changes_no_kernel(tmp_path):
    """Entries of three and of no radial coefficients, drawn together and alone."""
    bent, plain_lens = entry_of(1500.0, (-0.05, 0.01, -0.01)), entry_of(4000.0, ())
    states = (1500.0, 2.8, 1000.0), (4000.0, 2.8, 1000.0)
    both = kernel_sheets(report_of(*states), saved(tmp_path / "both", bent, plain_lens))
    alone = kernel_sheets(report_of(states[1]), saved(tmp_path / "one", plain_lens))
    assert both[1].state == alone[0].state
    assert both[1].png == alone[0].png
    assert both[0].png != both[1].png


def test_states_are_distinct_and_stated_charts_come_first(tmp_path):
    preset = load_preset(saved(tmp_path, entry_of(2000.0, ())))
    report = report_of(
        (2000.0, 1.4, None), (2000.0, 1.4, 1500.0), (2000.0, 1.4, 1500.0),
        ("inf", 2.8, None),
    )  # fmt: skip
    found = [(s.focus_distance_mm, s.f_number, s.object_distance_mm)
             for s in kernel_states(report, preset)]  # fmt: skip
    assert found == [(2000.0, 1.4, 1500.0), (math.inf, 2.8, 2000.0)]


def test_reach_is_the_square_that_holds_the_light():
    kernels = np.zeros((2, 64, 64))
    kernels[0, 31:33, 31:33] = 1
    kernels[1, 24:40, 28:36] = 1
    assert reach_share(kernels) == 16 / 64
    assert reach_share(np.ones((1, 64, 64))) == 1.0


def test_a_report_without_a_readable_preset_says_so(tmp_path):
    report = barrel_report(2)
    (tmp_path / "preset.json").write_text("{")
    assert kernel_sheets(report, tmp_path / "preset.json") == []
    draw_overlays(report, tmp_path, (400, 300))
    html = write_report(report, tmp_path).read_text(encoding="utf-8")
    assert "No kernels are drawn" in html
    assert 'data-figure="kernels"' not in html


def test_the_section_holds_table_kernels_and_dots(tmp_path):
    report = report_of((2000.0, 2.8, 1000.0))
    report["blur"][0]["takes"][0]["picture"] = "blur/dots_1.png"
    report["blur"][0]["defocus"][0]["target_distance_mm"] = 1000.0
    saved(tmp_path, entry_of(2000.0, ()))
    (tmp_path / "blur").mkdir()
    cv2.imwrite(str(tmp_path / "blur/dots_1.png"), np.zeros((40, 90), np.uint8))
    html = write_report(report, tmp_path).read_text(encoding="utf-8")
    assert html.count('data-figure="kernels"') == html.count('data-figure="dots"') == 1
    assert "No kernels are drawn" not in html
    section = html[html.index('id="blur"') : html.index('id="evidence"')]
    for text in (
        "−350.0 ± 3.0\u202fµm",
        "2.1%",
        "3.2%",
        "8 blades",
        "exit pupil",
        "f/2.8",
        "and the dots photographed",
    ):
        assert text in section
    report["blur"][0]["takes"][0]["targets"] = "corners"
    html = write_report(report, tmp_path).read_text(encoding="utf-8")
    assert "and the corners photographed" in html
    assert "Corners: green." in html


def test_defocus_is_told_besides_what_all_takes_have_in_common(tmp_path):
    report = report_of((2000.0, 2.8, 1000.0))
    group = report["blur"][0]["defocus"][0]
    group["target_distance_mm"] = 1000.0
    group["from_stated"] = {"defocus_mm": 0.52, "standard_deviation_mm": 0.001}
    saved(tmp_path, entry_of(2000.0, ()))
    html = write_report(report, tmp_path).read_text(encoding="utf-8")
    assert "520.0 ± 1.0\u202fµm" in html
    assert "−350.0" not in html


def test_an_old_report_has_no_such_section(tmp_path):
    report = barrel_report(1)
    del report["blur"]
    html = write_report(report, tmp_path).read_text(encoding="utf-8")
    assert 'id="blur"' not in html
    assert 'href="#blur"' not in html


def test_terms_of_several_states_are_one_row_that_names_them(tmp_path):
    report = barrel_report(1)
    report["terms"] = [
        report["terms"][0]
        | {"value": [value, 0.0], "standard_deviation": [0.1, 0.0]}
        | {"focal_length_mm": 50.0, "focus_distance_mm": focus}
        for value, focus in ((1.5, 2000.0), (2.5, "inf"))
    ]
    html = write_report(report, tmp_path).read_text(encoding="utf-8")
    table = html[html.index('id="terms"') :]
    assert table.count("<code>radial_2</code>") == 1
    for text in ("1.50 ± 0.10", "2.50 ± 0.10", "focused at 2\u202fm", "focused at ∞"):
        assert table.count(text) in (1, 2)
    assert "<div>0</div>" not in table


def test_terms_that_states_share_stand_once(tmp_path):
    report = barrel_report(1)
    term = report["terms"][0] | {"name": "blur_third_order", "value": [1.0, -7.5] * 4}
    report["terms"] += [term, copy.deepcopy(term)]
    html = write_report(report, tmp_path).read_text(encoding="utf-8")
    assert html.count("blur_third_order") == 1
    assert "8 values, the largest" in html
    assert "−7.5" in html


@pytest.mark.parametrize("dark", [False, True])
def test_what_the_model_explains_leaves_grey(dark):
    """A disc on a background: photograph and model alike, their difference one half."""
    disc = np.zeros((1, 24, 24))
    disc[0, 8:16, 8:16] = 3.0
    nothing, beside = np.zeros_like(disc), np.full(1, 5.0)
    photograph, model, left = dot_tiles(5.0 + disc, nothing, beside, dark=dark)
    np.testing.assert_array_equal(photograph, model)
    np.testing.assert_array_equal(left, 0.5)
    assert photograph.min() == 0.0
    assert photograph.max() == 1.0
    assert (photograph[0, 12, 12] < 0.5) == dark


def test_every_take_gets_a_picture_of_its_own_dots(tmp_path):
    """Three tiles in a column for each dot: photograph, model, what is left."""
    light = np.zeros((5, 3, 24, 24))
    light[:, :, 10:14, 10:14] = 1.0
    bright = SimpleNamespace(are_dark_dots=False)
    takes = [
        SimpleNamespace(take=SimpleNamespace(name=f"{n}.exr", observations=bright))
        for n in "ab"
    ]
    field_mm = np.linspace(0, 10, 10).reshape(5, 2)
    dot_data = SimpleNamespace(
        light=light,
        valid=np.ones(light.shape, bool),
        photographs=takes,
        take=np.array([0, 0, 0, 1, 1]),
        dots=SimpleNamespace(field_mm=field_mm),
    )
    stage = SimpleNamespace(
        dot_data=dot_data, residual=0 * light, nuisance=np.zeros((5, 3, 5))
    )
    wavefront = SimpleNamespace(stage=stage)
    stems = {"a.exr": "a", "b.exr": "b_2"}
    named = write_dot_pictures(wavefront, stems, tmp_path)  # pyright: ignore[reportArgumentType]
    assert named == {"a.exr": "blur/a.png", "b.exr": "blur/b_2.png"}
    pictures = [
        cv2.imread(str(tmp_path / name), cv2.IMREAD_GRAYSCALE)
        for name in named.values()
    ]
    sizes = [picture.shape for picture in pictures if picture is not None]
    assert sizes == [(3 * 50 + 2, 3 * 50 + 2), (3 * 50 + 2, 2 * 50 + 2)]


def test_tiles_lie_as_rows_and_columns_over_a_bar():
    tiles = np.arange(6).reshape(2, 3, 1, 1) / 5 * np.ones((4, 5))
    sheet = sheet_of(tiles)
    assert sheet.shape == (2 * 6 + 2, 3 * 7 + 2)
    assert [int(sheet[4 + 6 * r, 4 + 7 * c]) for r in (0, 1) for c in (0, 1, 2)] == [
        0, 51, 102, 153, 204, 255,
    ]  # fmt: skip
    strip = with_bar(sheet, 8.0)[sheet.shape[0] :]
    assert (strip == 255).any(0).sum() == 8


def test_numbers_are_as_json_holds_them():
    assert plain(math.nan) is None
    assert plain(0.5) == 0.5
    for distance in (None, 2000.0, math.inf):
        assert distance_of(plain_distance(distance)) == distance
    assert plain_distance(math.inf) == "inf"
