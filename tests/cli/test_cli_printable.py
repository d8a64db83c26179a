"""Text of others never moves the terminal, turns a line around or breaks a file."""

import json
import unicodedata
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from command_line import run, run_well
from plate_makers import CAMERA, SENSOR, make_preset, write_plate

from lensfit.errors import LensfitError
from lensfit.preset.library.edit import keep_preset
from lensfit.preset.library.levels import levels_of
from lensfit.preset.schema import LensName, Saved
from lensfit.preset.store import save_preset
from lensfit.printable import printable

EVIL = "Cooke\x1b[2J \u202egnitrevni\u202c 50\x07\x9b1m\u200b"
SHOWN = "Cooke\\x1b[2J \\u202egnitrevni\\u202c 50\\x07\\x9b1m\\u200b"


def clean(text: str) -> bool:
    """No control or format character but the end of lines."""
    kinds = {unicodedata.category(c) for c in text if c != "\n"}
    return not kinds & {"Cc", "Cf", "Zl", "Zp", "Cs"}


@pytest.fixture
def preset(tmp_path: Path) -> Path:
    named = msgspec.structs.replace(
        make_preset(), lens=LensName(EVIL), saved=Saved(EVIL, "today", EVIL)
    )
    save_preset(named, tmp_path / "preset.json")
    return tmp_path / "preset.json"


def test_letters_of_every_script_stay_and_the_rest_is_seen():
    for text in (
        "SMC Takumar 50/1.4",
        "蔡司 35 mm f/2",
        "Größe µ ×",
        "عدسة",
        "שלום",
        "می\u200cخواهم",
    ):
        assert printable(text) == text
    assert printable(EVIL) == SHOWN
    assert printable("a\nb\t\u2028\ud800") == "a\\x0ab\\x09\\u2028\\ud800"
    assert printable("50\U000e0041") == "50\\U000e0041"
    assert str(LensfitError(f"{EVIL} is bad", where="蔡司\u3000")) == (
        f"蔡司 : {SHOWN} is bad"
    )


def test_headers_and_file_names_are_shown_plainly(tmp_path, preset):
    header = {**CAMERA, **SENSOR, "lensModel": EVIL, "owner": EVIL}
    plate = write_plate(tmp_path / f"{EVIL.replace('/', '')}.exr", header)
    done = run_well("inspect", plate, "--preset", preset)
    assert clean(done.stdout)
    assert clean(done.stderr)
    assert "gnitrevni" in done.stdout
    write_plate(tmp_path / "a\x1b[31m.1.exr", {})
    words = ["apply", preset, tmp_path / "a\x1b[31m.#.exr", "--out", tmp_path / "out"]
    done = run(*words)
    assert done.exit_code == 1
    assert clean(done.stderr)


def test_paths_of_results_are_shown_plainly(tmp_path, preset):
    folder = tmp_path / "a\u202eb\x1b[2J"
    folder.mkdir()
    saved = run_well("preset", "save", preset, "--library", folder)
    for done in (saved, run_well("preset", "validate", folder)):
        assert clean(done.stdout)
        assert "a\\u202eb\\x1b[2J" in done.stdout


def test_presets_and_their_history_are_shown_plainly(tmp_path, preset):
    done = run_well("preset", "show", preset)
    assert clean(done.stdout)
    assert SHOWN in done.stdout
    library = tmp_path / "show"
    library.mkdir()
    level = levels_of(library)[0]
    named = msgspec.structs.replace(make_preset(), lens=LensName(EVIL))
    kept = keep_preset(named, level, who=EVIL, note=EVIL)
    for command in ("history", "show"):
        assert clean(
            run_well("preset", command, kept.slug, "--library", library).stdout
        )
    words = ["preset", "edit", kept.slug, "--library", library, "--set"]
    edited = run_well(*words, "coma_gain=0.5", "--why", EVIL, "--who", EVIL)
    assert clean(edited.stdout)
    assert clean(run_well("preset", "list", "--library", library).stdout)
    one, other = f"{kept.slug}@v001", f"{kept.slug}@v002"
    assert clean(run_well("preset", "diff", one, other, "--library", library).stdout)


def test_files_of_other_programs_stay_readable(tmp_path, preset):
    run_well("export", preset, "--to", "lensfun", "--out", tmp_path / "a.xml")
    root = ElementTree.parse(tmp_path / "a.xml").getroot()
    assert root.findtext("lens/model") == SHOWN
    run_well("export", preset, "--to", "opencv", "--out", tmp_path / "a.yml")
    file = cv2.FileStorage(str(tmp_path / "a.yml"), cv2.FILE_STORAGE_READ)
    assert np.isfinite(file.getNode("camera_matrix").mat()).all()
    run_well("export", preset, "--to", "nuke-stmap", "--out", tmp_path / "a.nk")
    assert clean((tmp_path / "a.nk").read_text())
    run_well("export", preset, "--to", "opentrackio", "--out", tmp_path / "a.json")
    json.loads((tmp_path / "a.json").read_text())
