"""A draft filled in from a camera report, and what it leaves to be confirmed."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from command_line import run
from PIL import Image

from lensfit.workflow.shoot.shoot_file import load_shoot

REPORT = """File,Lens,T-Stop,Focus,Chart Distance,Focal Length
near,Prime 35,T2.8,4'11",5 ft,35
far,Prime 35,f/4,1.5 m,5 ft,35mm
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, focal in (("near.jpg", 35), ("far.jpg", 50)):
        exif = Image.Exif()
        exif.get_ifd(0x8769)[0x920A] = float(focal)  # FocalLength
        exif.get_ifd(0x8769)[0x9003] = "2026:05:01 10:00:00"  # DateTimeOriginal
        Image.new("RGB", (64, 48), (90, 90, 90)).save(tmp_path / name, exif=exif)
    (tmp_path / "report.csv").write_text(REPORT, encoding="utf-8")
    return tmp_path


def drafted(folder: Path, *images: str):
    shoot = folder / "shoot.toml"
    command = ["inspect", *(str(folder / name) for name in images)]
    command += ["--write-shoot", str(shoot), "--slates", str(folder / "report.csv")]
    return run(*command), shoot


def test_the_report_fills_in_the_draft(folder: Path):
    result, path = drafted(folder, "near.jpg", "far.jpg")
    assert result.exit_code == 0, result.output
    near, far = load_shoot(path).takes
    assert near.f_number == 2.8
    assert near.focus_distance_mm == pytest.approx(59 * 25.4)
    assert near.target_distance_mm == far.target_distance_mm == 60 * 25.4
    assert far.f_number == 4
    assert far.focus_distance_mm == 1500
    assert far.focal_length_mm == 35
    text = path.read_text()
    assert "report.csv line 2" in text
    assert "T-stops" in " ".join(load_shoot(path).notes)


def test_where_report_and_header_differ_someone_has_to_confirm(folder: Path):
    _, path = drafted(folder, "near.jpg", "far.jpg")
    left = load_shoot(path).unconfirmed
    assert "[[take]] 2, focal_length_mm" in left
    assert "[[take]] 1, focal_length_mm" not in left
    assert "[[target]] 1, pitch_mm" in left


def test_a_tiff_that_may_be_linear_has_to_be_confirmed(folder: Path):
    tifffile.imwrite(folder / "near.tif", np.full((48, 64, 3), 9000, np.uint16))
    _, path = drafted(folder, "near.tif")
    assert "[[take]] 1, encoding" in load_shoot(path).unconfirmed


@pytest.mark.parametrize(
    ("cell", "words"), [("1500", "no focus distance"), ("five", "is no length")]
)
def test_a_cell_that_is_none_names_its_line(folder: Path, cell: str, words: str):
    (folder / "report.csv").write_text(REPORT.replace("4'11\"", cell))
    result, path = drafted(folder, "near.jpg")
    assert result.exit_code == 1
    assert "report.csv line 2" in result.stderr
    assert words in result.stderr
    assert not path.exists()


def test_a_report_of_other_photographs_is_said(folder: Path):
    (folder / "report.csv").write_text("File Name,T-Stop\nx.jpg,4\n", encoding="utf-8")
    result, _ = drafted(folder, "near.jpg", "far.jpg")
    assert result.exit_code == 0
    assert "report.csv: none of its rows is of these photographs" in result.stderr
