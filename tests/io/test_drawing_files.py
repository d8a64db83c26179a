"""Chart files hold millimetres: SVG to a billionth, PDF to its printed digits."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import label

from lensfit.chart.coverage import paint
from lensfit.chart.drawing import Drawing
from lensfit.chart.layout import Layout, Wanted, draw, foil_drawing, lay_out
from lensfit.chart.pattern import lattice_points
from lensfit.chart.sheet import paper_sheet
from lensfit.errors import ChartError
from lensfit.io.drawing_files import dxf, svg, write_pdf, write_png, write_tones_exr
from lensfit.io.image import read_photograph

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def dots() -> tuple[Layout, Drawing]:
    layout = lay_out(paper_sheet("A4"), Wanted("dot-grid", 11.3, 2.9))
    return layout, draw(layout, "1.2.3")


def test_every_dot_lies_where_it_should_in_svg(dots):
    layout, drawing = dots
    tree = ET.fromstring(svg(drawing))
    assert (tree.get("width"), tree.get("viewBox")) == ("297mm", "0 0 297 210")
    found = np.array(
        [
            [float(c.get(k)) for k in ("cx", "cy", "r")]
            for c in tree.iter(SVG + "circle")
        ]
    )
    points = lattice_points(layout.pattern)
    missing = (points[:, None] == layout.pattern.orientation_marks).all(-1).any(-1)
    assert missing.sum() == 4
    true = points[~missing] * 11.3 + layout.origin_mm
    np.testing.assert_allclose(found[:, :2], true, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[:, 2], 2.9 / 2, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_foil_is_cut_along_the_same_dots_and_stays_in_one_piece(dots):
    layout, drawing = dots
    holes = foil_drawing(layout)
    lines = iter(dxf(holes).splitlines())
    groups = [(int(code), value) for code, value in zip(lines, lines, strict=True)]
    at = [k for k, group in enumerate(groups) if group == (0, "CIRCLE")]
    circles = np.array([[float(groups[k + n][1]) for n in (2, 3, 4)] for k in at])
    true = drawing.layers[0].discs_mm * [1, -1, 1] + [0, drawing.height_mm, 0]
    np.testing.assert_allclose(circles, true, rtol=0, atol=1e-6)
    boxes = sum(len(layer.boxes_mm) for layer in holes.layers)
    assert groups.count((0, "POLYLINE")) == groups.count((0, "SEQEND")) == boxes > 0
    assert groups.count((0, "VERTEX")) == 4 * boxes
    foil = paint(holes, 0.02) < 0.5
    assert label(foil)[1] == 1
    assert label(paint(drawing, 0.02) < 0.5)[1] > 1  # as printed, parts would fall out


def test_what_would_fall_apart_is_not_cut():
    lines = lay_out(paper_sheet("A4"), Wanted("line-grid"))
    with pytest.raises(ChartError, match="falls apart"):
        foil_drawing(lines)


def test_the_bar_of_the_ruler_is_100_mm_long(dots):
    layout, drawing = dots
    boxes = list(ET.fromstring(svg(drawing)).iter(SVG + "rect"))
    widths = [float(box.get("width")) for box in boxes]
    bar = boxes[widths.index(100.0)]
    assert float(bar.get("x")) == pytest.approx(layout.ruler_at_mm[0], abs=1e-9)
    ticks = [
        float(box.get("x")) - float(bar.get("x")) + 0.1
        for box in boxes
        if float(box.get("width")) == pytest.approx(0.2)
    ]
    assert len(ticks) == 101
    np.testing.assert_allclose(ticks[1:-1], np.arange(1, 100), rtol=0, atol=1e-9)


def test_the_commands_of_a_pdf_are_the_same_chart(dots, tmp_path: Path):
    layout, drawing = dots
    write_pdf(tmp_path / "chart.pdf", drawing, compressed=False)
    text = (tmp_path / "chart.pdf").read_bytes().decode("latin-1")
    box = re.search(r"/MediaBox \[ ?0 0 (\S+) (\S+) ?\]", text)
    assert box is not None
    points = 72 / 25.4
    assert float(box[1]) == pytest.approx(297 * points, abs=1e-6)
    assert float(box[2]) == pytest.approx(210 * points, abs=1e-6)
    # each disc starts at its top or bottom and is eight curves
    discs = re.findall(r"([\d.]+) ([\d.]+) m\n((?:(?:[\d.]+ ){6}c\n){8})", text)
    rings = [
        np.array([[float(n) for n in row.split()[4:6]] for row in ring.splitlines()])
        for _, _, ring in discs
    ]
    sized = [
        r for r in rings if np.ptp(r[:, 0]) == pytest.approx(2.9 * points, abs=1e-4)
    ]
    lattice = lattice_points(layout.pattern)
    assert len(sized) == len(lattice) - 4
    centres = np.array([r.mean(0) for r in sized]) / points
    centres[:, 1] = 210 - centres[:, 1]
    steps = (centres - layout.origin_mm) / 11.3
    np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=1e-6)


def test_pictures_hold_the_same_light(tmp_path: Path):
    tones = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    write_png(tmp_path / "a.png", tones, 0.1)
    write_tones_exr(tmp_path / "a.exr", tones)
    exact = read_photograph(tmp_path / "a.exr")
    np.testing.assert_array_equal(exact.pixels[..., 1], tones)
    coded = read_photograph(tmp_path / "a.png")
    np.testing.assert_allclose(coded.pixels[..., 0], tones, atol=0.005)
    with Image.open(tmp_path / "a.png") as image:
        assert image.info["dpi"] == pytest.approx((254, 254), rel=1e-4)
