"""Keys set in a settings file, which stays as it was otherwise; knobs as an edit.

An edit is a version of the lens, with who and why on record.
"""

import math
import os
import tomllib
from pathlib import Path

import pytest
from view_makers import Client, served, thin_lens, write_depth_plate

from lensfit.errors import OutputError, SettingsError
from lensfit.plate.apply_options import ApplyOptions
from lensfit.preset.library.edit import keep_preset
from lensfit.preset.library.layers import find_preset
from lensfit.preset.library.levels import levels_of
from lensfit.workflow.view.lens_adjustments import (
    LibraryLens,
    StartCommand,
    changed_text,
    save_settings,
)
from lensfit.workflow.view.plate_server import PlateServer
from lensfit.workflow.view.viewed_plate import ViewedPlate

CHANGES = {"camera": {"f_number": 2.8}, "knobs": {"coma_gain": 0.5, "blades": 6}}
PATH = Path("lensfit.toml")
AUTHOR = {"who": "Ada", "why": "softer on faces"}


def test_a_file_that_is_not_there_is_made(tmp_path: Path):
    save_settings(tmp_path / PATH, CHANGES)
    assert (tmp_path / PATH).read_text() == (
        "[camera]\nf_number = 2.8\n\n[knobs]\ncoma_gain = 0.5\nblades = 6\n"
    )


@pytest.mark.parametrize(
    "old",
    [
        "",
        "\n\n",
        "# a comment alone",
        "[camera]",
        "[camera] # of the shot\nf_number=8 # T2\n\nsensor_width_mm = 36\n",
        '[aliases]\nf_number = "my/stop"\n[[frames]]\nrange = "1-9"\nf_number = 4\n',
        "[knobs]\nblades = 5\n[camera]\nfocal_length_mm = 35\n",
        '[ knobs ]\n"blades" = 5\n# the end',
        "[camera]\r\nf_number = 8\r\n",
    ],
)
def test_only_these_keys_change(old: str):
    before = tomllib.loads(old)
    after = tomllib.loads(changed_text(old, CHANGES, PATH))
    for table in ("camera", "knobs"):
        assert after.pop(table) == before.pop(table, {}) | CHANGES[table]
    assert after == before
    for line in old.splitlines():
        if "#" in line:
            assert line[line.index("#") :] in changed_text(old, CHANGES, PATH)


@pytest.mark.parametrize(
    "old",
    [
        "camera = {f_number = 8}\n",
        "camera.f_number = 8\n",
        "[knobs]\nfilter_image = '''\nblades = 1\n'''\nblades = 5\n",
    ],
)
def test_a_file_written_otherwise_is_left_and_said(old: str, tmp_path: Path):
    (tmp_path / PATH).write_text(old)
    with pytest.raises(SettingsError, match=r"f_number = 2\.8; coma_gain = 0\.5"):
        save_settings(tmp_path / PATH, CHANGES)
    assert (tmp_path / PATH).read_text() == old
    assert os.listdir(tmp_path) == [PATH.name]


def test_a_malformed_file_is_left_and_said(tmp_path: Path):
    (tmp_path / PATH).write_text("[camera\n")
    with pytest.raises(SettingsError, match="TOML"):
        save_settings(tmp_path / PATH, CHANGES)
    assert (tmp_path / PATH).read_text() == "[camera\n"


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path, monkeypatch):
    (tmp_path / PATH).write_text("[camera]\nf_number = 8\n")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError):
        save_settings(tmp_path / PATH, CHANGES)
    assert (tmp_path / PATH).read_text() == "[camera]\nf_number = 8\n"
    assert os.listdir(tmp_path) == [PATH.name]


def test_infinity_and_exact_numbers_survive():
    values = {"focus_distance_mm": math.inf, "f_number": 0.1 + 0.2}
    text = changed_text("", {"camera": values}, PATH)
    assert tomllib.loads(text)["camera"] == values


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    folder = tmp_path / "show"
    folder.mkdir()
    return folder


def server(plate: Path, shelved: LibraryLens | None) -> PlateServer:
    viewed = ViewedPlate(thin_lens(), str(plate), ApplyOptions())
    return PlateServer(viewed, StartCommand("lens", str(plate)), shelved)


def test_knobs_become_a_version_on_record(library: Path, tmp_path: Path):
    level = levels_of(library)[0]
    kept = keep_preset(thin_lens(), level, who="Ada")
    plate = write_depth_plate(tmp_path / "plate.exr")
    with served(server(plate, LibraryLens(kept.slug, library))) as client:
        assert client.get("api/lens").json()["shelved"] == kept.slug
        knobs = {"blades": 6, "bloom_gain": 0.25}
        answer = client.post("edit", knobs=knobs, **AUTHOR)
        assert answer.status == 200, answer.content
        found = find_preset(kept.slug, library)
        assert answer.json()["version"] == found.full_name
        assert found.preset.knobs.bokeh.blades == 6
        assert found.preset.knobs.look.bloom_gain == 0.25
        said = {str(one) for one in found.overrides}
        assert len(said) == 2
        assert all("by Ada" in one and "softer on faces" in one for one in said)
        for wrong in (
            {"knobs": knobs, "who": "Ada", "why": " "},
            {"knobs": {}, **AUTHOR},
            {"knobs": {"blades": 6}, **AUTHOR},
        ):
            assert client.post("edit", **wrong).status == 422
        assert find_preset(kept.slug, library).name == found.name


def test_a_preset_outside_a_library_says_so(tmp_path: Path):
    plate = write_depth_plate(tmp_path / "plate.exr")
    with served(server(plate, None)) as client:
        refused = _edit(client)
        assert "outside a library" in refused


def _edit(client: Client) -> str:
    answer = client.post("edit", knobs={"blades": 6}, **AUTHOR)
    assert answer.status == 422
    return answer.json()["error"]
