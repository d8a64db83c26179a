"""`lensfit export` and `lensfit preset import`, as they are typed."""

import json
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.errors import ExchangeError
from lensfit.exchange import export
from lensfit.preset.store import load_preset, save_preset

runner = CliRunner()
PRESET = Path(__file__).parent / "tiny_preset.json"
FILES = {
    "nuke-radial": "lens.nk",
    "nuke-anamorphic": "lens.nk",
    "opentrackio": "lens.json",
    "opencv": "lens.yaml",
    "lensfun": "lens.xml",
}


@pytest.fixture(scope="module")
def spherical(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The lens without its squeeze of 1.9, which no radial model holds: a fit that
    cannot come near takes thousands of steps."""
    preset = load_preset(PRESET)
    (entry,) = preset.entries
    plain = msgspec.structs.replace(entry.distortion, squeeze=1.0, field=None)
    entry = msgspec.structs.replace(entry, distortion=plain)
    path = tmp_path_factory.mktemp("lens") / "spherical.json"
    save_preset(msgspec.structs.replace(preset, entries=(entry,)), path)
    return path


def run(*arguments: str | Path):
    return runner.invoke(app, [str(a) for a in arguments])


@pytest.mark.parametrize("to", list(FILES))
def test_what_is_exported_is_imported_and_valid(
    tmp_path: Path, spherical: Path, to: str
):
    out, back = tmp_path / FILES[to], tmp_path / "back.json"
    written = run("export", spherical, "--to", to, "--out", out)
    assert written.exit_code == 0, written.output
    assert written.stdout.startswith(f"{out}\n")
    assert "rms" in written.stdout
    assert "worst" in written.stdout
    camera = load_preset(PRESET).camera
    found = run(
        "preset", "import", out, "--out", back,
        "--sensor-width-mm", camera.sensor_width_mm,
        "--size", f"{camera.image_width_px}x{camera.image_height_px}",
    )  # fmt: skip
    assert found.exit_code == 0, found.output
    assert "no uncertainty and no blur" in found.stderr
    assert run("preset", "validate", back).exit_code == 0


def test_results_for_machines(tmp_path: Path, spherical: Path):
    out = tmp_path / "lens.yaml"
    written = run("export", spherical, "--to", "opencv", "--out", out, "--json")
    told = json.loads(written.stdout)
    assert told["files"] == [str(out)]
    assert told["residuals"][0]["rms_px"] <= told["residuals"][0]["worst_px"]
    width = load_preset(PRESET).camera.sensor_width_mm
    back = tmp_path / "back.json"
    found = run(
        "preset", "import", out, "--out", back, "--sensor-width-mm", width, "--json"
    )
    told = json.loads(found.stdout)
    assert told["file"] == str(back)
    assert told["entries"][0]["distortion"]["worst_px"] < 1


def test_maps_are_those_of_stmap(tmp_path: Path):
    options = ("--size", "64x48", "--overscan", "10", "--per-channel")
    assert run("stmap", PRESET, "--out", tmp_path / "a", *options).exit_code == 0
    written = run("export", PRESET, "--to", "stmap", "--out", tmp_path / "b", *options)
    assert written.exit_code == 0, written.output
    names = [path.name for path in sorted((tmp_path / "a").iterdir())]
    assert names == [path.name for path in sorted((tmp_path / "b").iterdir())]
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (
            tmp_path / "b" / name
        ).read_bytes()


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("export", PRESET, "--to", "maya", "--out", "x"), 2, "--to"),
        (
            ("export", PRESET, "--to", "opencv", "--out", "x", "--size", "big"),
            2,
            "size",
        ),
        (("export", "none.json", "--to", "opencv", "--out", "x"), 1, "none"),
        (("preset", "import", PRESET, "--out", "x.json"), 1, "no pinholeFocalLength"),
        (("preset", "import", "none.yaml", "--out", "x.json"), 1, "No such file"),
        (("preset", "import", ".", "--out", "x.json"), 1, "no ordinary file"),
    ],
)
def test_failures_are_one_line(
    tmp_path: Path, monkeypatch, arguments, code: int, said: str
):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == code
    assert said in result.output
    if code == 1:
        assert result.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_error_is_not_its_own_cause(monkeypatch, tmp_path: Path):
    """Whoever follows the causes would go on for ever."""

    def failing(_):
        raise ExchangeError("no")

    monkeypatch.setitem(export.WRITERS, "stmap", failing)
    with pytest.raises(ExchangeError) as caught:
        export.export_preset("stmap", None)
    assert caught.value.__cause__ is None
