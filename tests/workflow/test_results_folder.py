"""The folder of a calibration's results: checked, and written all at once.

The results of one calibration, and only those, lie in its folder.
"""

import json
import os
from pathlib import Path

import msgspec
import pytest
from plate_makers import make_preset
from report_samples import barrel_report

from lensfit.errors import FitError, OutputError
from lensfit.preset.store import save_preset
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.calibration.results_folder import (
    atomic_results,
    files_of_report,
    results_folder,
)
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


SHOOT = Shoot(
    path=Path("shoot.toml"),
    lens=LensName("A"),
    camera=Camera(),
    targets={},
    takes=(Take(image="never_opened.exr", target="dots"),),
)


def report_of(*stems: str) -> dict:
    """A report whose takes are called so, with every picture that it may name."""
    report = barrel_report(takes=len(stems))
    modelled = ("photograph", "model", "left")
    for take, stem in zip(report["takes"], stems, strict=True):
        take["overlay"] = f"overlays/{stem}.png"
        take["modelled"] = {k: f"model/{stem}_{k}.jpg" for k in modelled}
    of_dots = [{"image": stem, "picture": f"blur/{stem}.png"} for stem in stems]
    report["blur"] = [{"focal_length_mm": 50.0, "takes": of_dots}]
    report["files"] = {"stmaps": [f"stmaps/{stem}_undistort.exr" for stem in stems]}
    return report


def write_results(folder: Path, *stems: str) -> None:
    """As `calibrate` does it; the files say which run they are of."""
    report = report_of(*stems)
    (folder / "report.json").write_text(json.dumps(report))
    for name in files_of_report(folder / "report.json"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(" ".join(stems))


def contents(folder: Path) -> dict[str, str]:
    found = [path for path in folder.rglob("*") if path.is_file()]
    return {p.relative_to(folder).as_posix(): p.read_text() for p in found}


@pytest.fixture
def held_files(tmp_path):
    """Two takes were calibrated, and their owner keeps files beside the results."""
    with atomic_results(tmp_path, SHOOT) as folder:
        write_results(folder, "one", "two")
    for name in ("stmaps/own_undistort.exr", "overlays/own.png", "own.txt"):
        (tmp_path / name).write_text("own")
    return tmp_path


def test_every_file_that_a_report_names_is_known(held_files):
    names = [name.as_posix() for name in files_of_report(held_files / "report.json")]
    assert len(names) == 2 * 6
    for stem in ("one", "two"):
        assert f"overlays/{stem}.png" in names
        assert f"blur/{stem}.png" in names
        assert f"stmaps/{stem}_undistort.exr" in names
        assert f"model/{stem}_left.jpg" in names


def test_a_second_run_of_fewer_takes_leaves_nothing_of_the_first(held_files):
    with atomic_results(held_files, SHOOT) as folder:
        write_results(folder, "two")
    found = contents(held_files)
    del found["report.json"]
    assert [name for name in found if "one" in name] == []
    assert [name for name, text in found.items() if text == "one two"] == []
    assert [name for name, text in found.items() if text == "own"] == [
        name for name in found if "own" in name
    ]
    assert len(found) == 6 + 3


def test_a_folder_that_only_the_first_run_filled_goes(held_files):
    with atomic_results(held_files, SHOOT) as folder:
        report = report_of("one") | {"blur": []}
        (folder / "report.json").write_text(json.dumps(report))
    assert not (held_files / "blur").exists()
    assert not (held_files / "model").exists()
    assert [path.name for path in (held_files / "overlays").iterdir()] == ["own.png"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, MemoryError])
def test_an_interrupted_run_changes_nothing(held_files, tmp_path, stop):
    def interrupted(out_dir: Path) -> None:
        with atomic_results(out_dir, SHOOT) as folder:
            write_results(folder, "two", "three")
            raise stop

    before = contents(held_files)
    for folder in (held_files, tmp_path / "fresh"):
        with pytest.raises(stop):
            interrupted(folder)
    assert contents(held_files) == before
    assert not (tmp_path / "fresh").exists()


def failed(out_dir: Path, *stems: str, remedy: str | None = None) -> str:
    def run() -> None:
        with atomic_results(out_dir, SHOOT) as folder:
            for stem in stems:
                (folder / "overlays").mkdir(exist_ok=True)
                (folder / f"overlays/{stem}.png").write_text("failed")
            raise FitError("nothing fits", where="dots", remedy=remedy)

    with pytest.raises(FitError) as caught:
        run()
    return str(caught.value)


def test_a_run_that_fails_keeps_its_overlays_apart(held_files):
    before = contents(held_files)
    said = failed(held_files, "one", "two", remedy="look at the overlays")
    assert said == (
        "dots: nothing fits; look at the overlays; the detected points are drawn "
        f"in {held_files / 'overlays_failed'}"
    )
    kept = {f"overlays_failed/{stem}.png": "failed" for stem in ("one", "two")}
    assert contents(held_files) == before | kept


def test_an_error_names_a_file_where_it_would_have_been(tmp_path):
    with (
        pytest.raises(FitError, match=r"preset\.json") as raised,
        atomic_results(tmp_path / "out", SHOOT) as folder,
    ):
        raise FitError("is not a number", where=folder / "preset.json")
    assert str(raised.value.where) == str(tmp_path / "out" / "preset.json")


def test_the_next_run_replaces_the_overlays_of_one_that_failed(held_files):
    failed(held_files, "one", "two")
    (held_files / "overlays_failed" / "own.txt").write_text("own")
    failed(held_files, "two")
    names = sorted(path.name for path in (held_files / "overlays_failed").iterdir())
    assert names == ["own.txt", "two.png"]
    (held_files / "overlays_failed" / "own.txt").unlink()
    with atomic_results(held_files, SHOOT) as folder:
        write_results(folder, "one")
    assert not (held_files / "overlays_failed").exists()


def test_a_run_that_found_nothing_at_all_leaves_no_folder(tmp_path):
    assert failed(tmp_path / "fresh") == "dots: nothing fits"
    assert not (tmp_path / "fresh").exists()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"takes": [{"overlay": "overlays/a.png"}]}',
        '{"schema": "lensfit.report.2", "takes": 3}',
        '{"schema": "lensfit.report.2", "takes": [{"overlay": "../a.png"}]}',
        '{"schema": "lensfit.report.2", "takes": [{"overlay": "/overlays/a.png"}]}',
        '{"schema": "lensfit.report.2", "takes": [{"overlay": "overlays/.."}]}',
        '{"schema": "lensfit.report.2", "takes": [{"overlay": "plates/a.png"}]}',
        '{"schema": "lensfit.report.2", "takes": [{"overlay": ["overlays/a.png"]}]}',
    ],
)
def test_a_report_from_elsewhere_names_nothing_to_remove(tmp_path, text):
    (tmp_path / "report.json").write_text(text)
    assert files_of_report(tmp_path / "report.json") == []
