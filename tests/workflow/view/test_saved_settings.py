"""Keys set in a settings file, which otherwise stays as it was written."""

import math
import os
import tomllib
from pathlib import Path

import pytest

from lensfit.errors import OutputError, SettingsError
from lensfit.workflow.view.saved_settings import changed_text, save_settings

CHANGES = {"camera": {"f_number": 2.8}, "knobs": {"coma_gain": 0.5, "blades": 6}}
PATH = Path("lensfit.toml")


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
