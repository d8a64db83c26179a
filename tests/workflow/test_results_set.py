"""The results of one calibration, and only those, lie in its folder."""

import json
from pathlib import Path

import pytest
from report_samples import barrel_report

from lensfit.errors import FitError
from lensfit.workflow.calibration.results_folder import atomic_results, files_of_report
from lensfit.workflow.shoot.shoot_records import Camera, LensName, Shoot, Take

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
def held(tmp_path):
    """Two takes were calibrated, and their owner keeps files beside the results."""
    with atomic_results(tmp_path, SHOOT) as folder:
        write_results(folder, "one", "two")
    for name in ("stmaps/own_undistort.exr", "overlays/own.png", "own.txt"):
        (tmp_path / name).write_text("own")
    return tmp_path


def test_every_file_that_a_report_names_is_known(held):
    names = [name.as_posix() for name in files_of_report(held / "report.json")]
    assert len(names) == 2 * 6
    for stem in ("one", "two"):
        assert f"overlays/{stem}.png" in names
        assert f"blur/{stem}.png" in names
        assert f"stmaps/{stem}_undistort.exr" in names
        assert f"model/{stem}_left.jpg" in names


def test_a_second_run_of_fewer_takes_leaves_nothing_of_the_first(held):
    with atomic_results(held, SHOOT) as folder:
        write_results(folder, "two")
    found = contents(held)
    del found["report.json"]
    assert [name for name in found if "one" in name] == []
    assert [name for name, text in found.items() if text == "one two"] == []
    assert [name for name, text in found.items() if text == "own"] == [
        name for name in found if "own" in name
    ]
    assert len(found) == 6 + 3


def test_a_folder_that_only_the_first_run_filled_goes(held):
    with atomic_results(held, SHOOT) as folder:
        report = report_of("one") | {"blur": []}
        (folder / "report.json").write_text(json.dumps(report))
    assert not (held / "blur").exists()
    assert not (held / "model").exists()
    assert [path.name for path in (held / "overlays").iterdir()] == ["own.png"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, MemoryError])
def test_an_interrupted_run_changes_nothing(held, tmp_path, stop):
    def interrupted(out_dir: Path) -> None:
        with atomic_results(out_dir, SHOOT) as folder:
            write_results(folder, "two", "three")
            raise stop

    before = contents(held)
    for folder in (held, tmp_path / "fresh"):
        with pytest.raises(stop):
            interrupted(folder)
    assert contents(held) == before
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


def test_a_run_that_fails_keeps_its_overlays_apart(held):
    before = contents(held)
    said = failed(held, "one", "two", remedy="look at the overlays")
    assert said == (
        "dots: nothing fits; look at the overlays; the detected points are drawn "
        f"in {held / 'overlays_failed'}"
    )
    kept = {f"overlays_failed/{stem}.png": "failed" for stem in ("one", "two")}
    assert contents(held) == before | kept


def test_an_error_names_a_file_where_it_would_have_been(tmp_path):
    with (
        pytest.raises(FitError, match=r"preset\.json") as raised,
        atomic_results(tmp_path / "out", SHOOT) as folder,
    ):
        raise FitError("is not a number", where=folder / "preset.json")
    assert str(raised.value.where) == str(tmp_path / "out" / "preset.json")


def test_the_next_run_replaces_the_overlays_of_one_that_failed(held):
    failed(held, "one", "two")
    (held / "overlays_failed" / "own.txt").write_text("own")
    failed(held, "two")
    names = sorted(path.name for path in (held / "overlays_failed").iterdir())
    assert names == ["own.txt", "two.png"]
    (held / "overlays_failed" / "own.txt").unlink()
    with atomic_results(held, SHOOT) as folder:
        write_results(folder, "one")
    assert not (held / "overlays_failed").exists()


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
