"""The folder of a calibration: of one lens, and found writable before any work."""

import os
from pathlib import Path

import msgspec
import pytest
from plate_makers import make_preset

from lensfit.errors import OutputError
from lensfit.preset.store import save_preset
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.calibration.results_folder import results_folder
from lensfit.workflow.shoot.shoot_records import Camera, LensName, Shoot, Take

TAKE = Take(image="never_opened.exr", target="dots")


def shoot_of(name: str, serial: str | None = None, model: str | None = None) -> Shoot:
    return Shoot(
        path=Path("shoot.toml"),
        lens=LensName(name, serial),
        camera=Camera(model=model),
        targets={},
        takes=(TAKE,),
    )


@pytest.fixture
def held(tmp_path):
    """A folder with the calibration of lens "A", serial 1, on camera "X"."""
    preset = make_preset()
    preset = msgspec.structs.replace(
        preset,
        lens=type(preset.lens)("A", "1"),
        camera=msgspec.structs.replace(preset.camera, model="X"),
    )
    save_preset(preset, tmp_path / "preset.json")
    return tmp_path


def test_the_same_lens_may_be_calibrated_again(held):
    for shoot in (shoot_of("A"), shoot_of("A", "1", "X")):
        assert results_folder(held, shoot) == held


@pytest.mark.parametrize(
    ("shoot", "said"),
    [
        (shoot_of("B"), 'holds the calibration of the lens "A", and this is "B"'),
        (shoot_of("A", "2"), 'of the lens of serial "1", and this is "2"'),
        (shoot_of("A", model="Y"), 'of a lens on the camera "X", and this is "Y"'),
    ],
)
def test_another_lens_is_refused_before_any_work(held, shoot, said):
    with pytest.raises(OutputError) as caught:
        calibrate(shoot, held)
    assert said in str(caught.value)
    assert "choose another --out, or remove the folder first" in str(caught.value)
    assert [path.name for path in held.iterdir()] == ["preset.json"]


def test_a_preset_that_cannot_be_read_is_not_replaced(tmp_path):
    (tmp_path / "preset.json").write_text("{}", encoding="utf-8")
    with pytest.raises(OutputError, match=r"holds a preset.json that cannot be read"):
        results_folder(tmp_path, shoot_of("A"))


def test_a_file_in_the_way_is_one_sentence(tmp_path):
    (tmp_path / "overlays").write_text("", encoding="utf-8")
    with pytest.raises(OutputError, match=r"overlays: the folder cannot be written"):
        results_folder(tmp_path, shoot_of("A"))


@pytest.mark.parametrize("inner", ["", "stmaps"])
def test_a_folder_that_may_not_be_written_is_found_before_any_work(tmp_path, inner):
    for name in ("overlays", "stmaps"):
        (tmp_path / name).mkdir()
    locked = tmp_path / inner
    locked.chmod(0o555)
    try:
        if os.access(locked, os.W_OK):
            pytest.skip("this user may write everywhere")
        with pytest.raises(OutputError, match=r"cannot be written \(Permission"):
            calibrate(shoot_of("A"), tmp_path)
    finally:
        locked.chmod(0o755)
