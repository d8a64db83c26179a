"""Knobs saved as an edit: a version of the lens, with who and why on record."""

from pathlib import Path

import pytest
from view_makers import Client, served, thin_lens, write_depth_plate

from lensfit.plate.apply_options import ApplyOptions
from lensfit.preset.library.levels import levels_of
from lensfit.preset.library.resolve_preset import find_preset
from lensfit.preset.library.save import keep_preset
from lensfit.workflow.view.lens_adjustments import StartCommand
from lensfit.workflow.view.plate_server import PlateServer
from lensfit.workflow.view.saved_edit import LibraryLens
from lensfit.workflow.view.viewed_plate import ViewedPlate

AUTHOR = {"who": "Ada", "why": "softer on faces"}


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
