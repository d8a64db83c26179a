"""`lensfit preset` with a library: save, edit, look, compare, take out; and apply."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.preset.knobs import active_knobs
from lensfit.preset.store import load_preset

PRESET = Path(__file__).parent / "tiny_preset.json"
SLUG = "smc-takumar-50-1-4_1234567"
runner = CliRunner(env={"COLUMNS": "200", "LENSFIT_LIBRARY": ""})


def preset(*words: object, code: int = 0) -> str:
    """Standard output of `lensfit preset ...`; the error where one is expected."""
    result = runner.invoke(app, ["preset", *map(str, words)])
    assert result.exit_code == code, result.output
    if code == 1:
        assert result.stdout == ""
        assert result.stderr.count("\n") == 1
        return result.stderr
    return result.stdout


@pytest.fixture
def show(tmp_path: Path, monkeypatch) -> Path:
    """A project with one saved lens; the working directory is beside it."""
    (tmp_path / "show" / "sq010" / "sh0020").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    preset("project", "show", "--who", "ana")
    preset("save", PRESET, "--library", "show", "--who", "ana", "--note", "test day")
    return tmp_path / "show"


def test_save_prints_the_path_and_counts_up(show: Path):
    said = preset("save", PRESET, "--library", "show", "--json")
    assert json.loads(said) == {
        "path": str(show / "lenses" / SLUG / "v002.json"),
        "lens": SLUG,
        "version": "v002",
    }
    loaded = load_preset(show / "lenses" / SLUG / "v001.json")
    assert loaded.entries == load_preset(PRESET).entries
    assert loaded.saved is not None
    assert (loaded.saved.who, loaded.saved.note) == ("ana", "test day")


def test_from_edit_to_file(show: Path):
    shot = "show/sq010/sh0020"
    preset(
        *("edit", "smc-takumar-50-1-4", "--library", shot, "--set", "coma_gain=0.5"),
        *("--why", "too strong", "--who", "bo"),
    )
    told = preset("show", SLUG, "--library", shot)
    assert "knobs.aberration.coma_gain = 0.5 (was 1) at sq010/sh0020 v001 by bo" in told
    assert "too strong" in told
    assert "too strong" not in preset("show", SLUG, "--library", "show")
    history = json.loads(preset("history", SLUG, "--library", shot, "--json"))
    assert [e["version"] for e in history] == ["v001", "v001"]
    rows = json.loads(preset("list", "--library", shot, "--json"))
    assert [(r["level"], r["change_set"]) for r in rows] == [
        ("sq010/sh0020", True),
        ("project", False),
    ]
    preset("load", SLUG, "--library", shot, "--out", "out.json", "--who", "cy")
    assert load_preset("out.json").knobs.aberration.coma_gain == 0.5
    found = json.loads(preset("diff", PRESET, "out.json", "--json"))
    assert found == [
        {
            "key": "knobs.aberration.coma_gain",
            "a": 1.0,
            "b": 0.5,
            "relative": -0.5,
            "deviations": None,
        }
    ]
    assert preset("validate", shot).count(": valid\n") == 4


def test_the_list_calls_a_change_set_a_change_set(show: Path):
    preset("edit", SLUG, "--library", "show/sq010", "--set", "coma_gain=1", "--why=x")
    first, second = preset("list", "--library", "show/sq010").splitlines()[1:]
    assert "sq010" in first
    assert first.endswith(", change set")
    assert "change set" not in second


def test_the_same_version_of_two_levels(show: Path):
    shot = ("--library", "show/sq010")
    preset("edit", SLUG, *shot, "--set", "coma_gain=0.5", "--why", "x")
    said = preset("diff", f"project:{SLUG}@v001", f"sq010:{SLUG}@v001", *shot)
    assert said.splitlines() == [
        f"project:{SLUG}@v001 -> sq010:{SLUG}@v001",
        "knobs.aberration.coma_gain: 1 -> 0.5 (-50 %)",
    ]
    words = ["preset", "load", f"{SLUG}@v001", *shot, "--out", "out.json"]
    loaded = runner.invoke(app, words)
    assert loaded.stdout.startswith(f"out.json: sq010:{SLUG}@v001, ")
    assert f"{SLUG}@v001 is that of sq010; others of that" in loaded.stderr
    assert f"project:{SLUG}@v001" in loaded.stderr
    told = preset("show", f"project:{SLUG}@v001", *shot)
    assert "project v001: " in told
    assert "coma_gain" not in told


def test_measured_values_are_locked(show: Path):
    words = ["edit", SLUG, "--library", "show", "--why", "x"]
    words += ["--set", "entries[0].distortion.squeeze=1.5"]
    assert "was measured and is locked" in preset(*words, code=1)
    preset(*words, "--unlock")
    assert "(unlocked): x" in preset("history", SLUG, "--library", "show")


def test_the_default_is_marked_and_marked_again(show: Path):
    preset("save", PRESET, "--library", "show")
    preset("default", f"{SLUG}@v001", "--library", "show")
    saved = runner.invoke(app, ["preset", "save", str(PRESET), "--library", "show"])
    assert "v001 is in use when no version is named" in saved.stderr
    preset("save", PRESET, "--library", "show", "--default")
    (row,) = json.loads(preset("list", "--library", "show", "--json"))
    assert (row["in_use"], row["marked"]) == ("v004", "v004")
    assert "holds v001" not in preset("default", SLUG, "--library", "show", code=1)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["show", "takuma"], "neither a file nor a lens of this library; did you mean"),
        (["show", f"{SLUG}@v009"], "has no v009; it holds v001"),
        (["show", f"{SLUG}@v999999999"], "is no version"),
        (["show", f"projct:{SLUG}@v001"], "'projct' is no level here; levels are proj"),
        (["show", f"project:{SLUG}@v002"], "has no v002; it holds v001"),
        (["load", "../x", "--out", "o.json"], "cannot be read"),
        (["edit", SLUG, "--why", "x"], "nothing to change"),
        (["edit", SLUG, "--why", " ", "--set", "coma_gain=0"], "says who and why"),
        (["edit", SLUG, "--why", "x", "--set", "coma_gian=0"], 'did you mean "coma_g'),
        (["edit", SLUG, "--why", "x", "--drop", "coma_gain"], "is not changed at"),
        (["history", "nobody"], "neither a file nor a lens"),
        (["diff", SLUG, "none.json"], "cannot be read"),
        (["default", f"{SLUG}@v7"], "has no v007"),
    ],
)
def test_mistakes_are_one_line(show: Path, words: list[str], said: str):
    assert said in preset(*words, "--library", "show", code=1)


def test_a_narrow_terminal_cuts_no_name(show: Path, monkeypatch):
    from rich.console import Console

    preset(
        "edit", SLUG, "--library", "show/sq010", "--set", "coma_gain=1", "--why", "x"
    )
    monkeypatch.setattr("lensfit.cli._terminal.console", lambda: Console(width=60))
    said = preset("list", "--library", "show/sq010")
    assert said.count(SLUG) == 2
    assert "…" not in said


def test_the_library_may_be_named_by_the_environment(show: Path):
    result = runner.invoke(
        app, ["preset", "show", SLUG], env={"LENSFIT_LIBRARY": str(show)}
    )
    assert result.exit_code == 0
    assert "project v001" in result.stdout


def test_maps_of_a_lens_by_name(show: Path):
    words = ["stmap", f"{SLUG}@v001", "--library", "show", "--size", "64x48"]
    result = runner.invoke(app, [*words, "--out", "maps", "--json"])
    assert result.exit_code == 0, result.output
    assert len(json.loads(result.stdout)["files"]) == 2


def test_a_farm_job_keeps_the_version_it_was_given(show: Path):
    Path("plate.0001.exr").touch()
    words = ["submit", SLUG, "plate.####.exr", "--library", "show", "--out", "o"]
    assert runner.invoke(app, words).exit_code == 0
    paths = json.loads(Path("o/apply.openjd.parameters.json").read_text())
    assert str(show / "lenses" / SLUG / "v001.json") in paths.values()


@pytest.mark.parametrize("named", [True, False])
def test_later_edits_change_no_frame_of_a_farm_job(show: Path, named: bool):
    Path("plate.0001.exr").touch()
    shot = show / "sq010" / "sh0020"
    edit = ("--why", "x", "--set")
    preset("edit", SLUG, "--library", shot, *edit, "coma_gain=0.5")
    lens = SLUG if named else str(shot / "lenses" / SLUG / "v001.json")
    words = ["submit", lens, "plate.####.exr", "--library", str(shot), "--out", "o"]
    assert runner.invoke(app, words).exit_code == 0
    preset("edit", SLUG, "--library", "show/sq010", *edit, "distortion_gain=3")
    assert "distortion_gain = 3" in preset("show", lens, "--library", shot)
    paths = json.loads(Path("o/apply.openjd.parameters.json").read_text())
    handed = load_preset(paths["Preset"])
    assert Path(paths["Preset"]).name == "apply.openjd.preset.json"
    assert active_knobs(handed.knobs) == {"coma_gain": 0.5}
    assert handed.saved is not None
    assert "sh0020 v001 on project v001" in (handed.saved.origin or "")


def test_without_a_library_the_users_own_is_used(tmp_path: Path, monkeypatch):
    import platformdirs

    monkeypatch.setattr(
        platformdirs, "user_data_dir", lambda *a, **k: str(tmp_path / "u")
    )
    said = preset("save", PRESET)
    assert said == f"{tmp_path / 'u' / 'lenses' / SLUG / 'v001.json'}\n"
    assert "library v001" in preset("show", SLUG)
