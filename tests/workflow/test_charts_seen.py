"""A chart says what it is, so that a shoot file need not."""

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from lensfit.chart.coverage import paint
from lensfit.chart.layout import Layout, Wanted, draw, lay_out
from lensfit.chart.sheet import paper_sheet
from lensfit.detect.observations import Observations
from lensfit.errors import ShootError
from lensfit.io.drawing_files import write_tones_exr
from lensfit.workflow.calibration.observe import observe_shoot
from lensfit.workflow.inspect import facts, inspect_images
from lensfit.workflow.shoot.draft import write_draft_shoot
from lensfit.workflow.shoot.resolve_take import (
    pattern_of_target,
    with_identified_charts,
)
from lensfit.workflow.shoot.shoot_file import load_shoot

HEAD = """
[lens]
name = "test"
[camera]
sensor_width_mm = 36.0
"""
TAKE = """
[[take]]
image = "{}"
focal_length_mm = 50.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two charts seen squarely; the dots also upside down, and out of focus."""
    folder = tmp_path_factory.mktemp("charts")
    for kind in ("dot-grid", "line-grid"):
        layout = chart(kind)
        picture = 0.02 + 0.7 * paint(draw(layout, "0"), 0.25)
        picture = np.pad(picture, 20, constant_values=0.2)
        sharp = cv2.GaussianBlur(picture, (0, 0), 0.8)
        sharp += 0.003 * np.random.default_rng(0).normal(size=sharp.shape)
        write_tones_exr(folder / f"{kind}.exr", sharp)
        if kind == "dot-grid":
            write_tones_exr(folder / "turned.exr", sharp[::-1, ::-1])
            write_tones_exr(folder / "soft.exr", cv2.GaussianBlur(picture, (0, 0), 5))
    return folder


def chart(kind: str) -> Layout:
    return lay_out(paper_sheet("A4"), Wanted(kind, 16.0))


def shoot_of(folder: Path, *images: str, more: str = ""):
    path = folder / "shoot.toml"
    path.write_text(HEAD + more + "".join(TAKE.format(name) for name in images))
    return load_shoot(path)


def quiet(*_: object) -> None:
    pass


def marks_of(shoot) -> list[Observations]:
    observed = observe_shoot(shoot, None, quiet)
    assert [o.failed for o in observed] == [None] * len(observed)
    return [o.take.observations for o in observed]


def test_one_sharp_take_names_the_target_of_all(folder: Path):
    shoot = shoot_of(folder, "dot-grid.exr", "turned.exr", "soft.exr")
    read = with_identified_charts(shoot)
    assert {take.target for take in read.takes} == {"dot-grid"}
    target = read.targets["dot-grid"]
    assert (target.pitch_mm, target.hole_diameter_mm) == (16.0, 4.0)
    assert pattern_of_target(target) == chart("dot-grid").pattern
    assert any("pitch 16 mm" in note for note in read.notes)
    sharp, turned, soft = marks_of(read)
    assert len(sharp) == len(soft)
    # the same dot has the same number however the chart stands
    place = {tuple(n): p for n, p in zip(sharp.lattice, sharp.points_px, strict=True)}
    size = np.array(sharp.image_size_px)
    for number, point in zip(turned.lattice, turned.points_px, strict=True):
        np.testing.assert_allclose(size - point, place[tuple(number)], atol=0.02)


def test_two_charts_are_told_apart_and_an_unreadable_take_says_so(folder: Path):
    shoot = shoot_of(folder, "dot-grid.exr", "line-grid.exr", "soft.exr")
    read = with_identified_charts(shoot)
    assert [t.target for t in read.takes] == ["dot-grid", "line-grid", None]
    assert read.targets["line-grid"].line_width_mm == pytest.approx(0.96)
    with pytest.raises(ShootError, match=r"soft\.exr.*no chart's code can be read"):
        read.target_of(read.takes[2])
    failed = [o.failed for o in observe_shoot(read, None, quiet)]
    assert failed[:2] == [None, None]
    assert "target" in str(failed[2])


def test_a_photograph_that_is_not_there_says_what_to_do(folder: Path):
    shoot = shoot_of(folder, "dot-grid.exr", "dot_grid.exr")
    _, missing = observe_shoot(shoot, None, quiet)
    assert missing.failed == (
        f"{folder / 'dot_grid.exr'}: cannot be read (No such file or directory); "
        "correct its name in shoot.toml, or say with --images which folder holds it"
    )


def test_a_stated_target_counts_and_needs_no_code(folder: Path):
    stated = '[[target]]\nname = "mine"\nkind = "dot-grid"\npitch_mm = 15.9\n'
    text = HEAD + stated + TAKE.format("soft.exr") + 'target = "mine"\n'
    (folder / "stated.toml").write_text(text)
    shoot = load_shoot(folder / "stated.toml")
    assert with_identified_charts(shoot) is shoot
    (marks,) = marks_of(shoot)
    assert marks.lattice.min() == 0


def test_a_draft_states_what_the_chart_says(folder: Path):
    inspections, errors = inspect_images(
        [folder / "soft.exr", folder / "dot-grid.exr"], charts=True
    )
    assert errors == []
    assert any(line[0] == "chart" for line in facts(inspections[1]))
    path = folder / "draft" / "shoot.toml"
    write_draft_shoot(path, inspections)
    (target,) = tomllib.loads(path.read_text())["target"]
    pattern = chart("dot-grid").pattern
    assert target["pitch_mm"] == 16.0
    assert target["marks"] == [pattern.columns, pattern.rows]
    shoot = load_shoot(path)
    assert {take.target for take in shoot.takes} == {"dot-grid"}
    assert pattern_of_target(shoot.targets["dot-grid"]) == pattern
