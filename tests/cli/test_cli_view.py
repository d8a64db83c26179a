"""`lensfit view`: what it refuses in a line, and a process that ends with Ctrl-C."""

import json
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.preset.store import save_preset
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset

HEADER = {"lens/focal": 35.0, "lens/fstop": 2.0, "lens/focus": 2.0}


@pytest.fixture
def lens(tmp_path: Path) -> Path:
    made = thin_lens_preset(ThinCamera(35.0, 2.0, 2.0, 36.0, 32, 18))
    save_preset(made, tmp_path / "thin.json")
    return tmp_path / "thin.json"


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    window = Window.of_size(32, 18)
    ones = np.ones((18, 32), np.float16)
    channels = {name: ones for name in "RGB"} | {"Z": 3 * ones}
    part = ExrPart(channels, window, window, HEADER)
    write_exr(tmp_path / "plate.exr", ExrImage((part,)))
    return tmp_path / "plate.exr"


def refused(*words: str | Path) -> str:
    found = run("view", *words, "--no-browser")
    assert found.exit_code == 1
    assert found.stdout == ""
    assert found.stderr.count("\n") == 1
    return found.stderr


def test_a_folder_without_results_is_named(tmp_path: Path):
    assert "report.json" in refused(tmp_path)


def test_a_folder_of_a_shoot_names_the_shoot_file(tmp_path: Path):
    (tmp_path / "shoot.toml").write_text("")
    said = refused(tmp_path)
    assert f"lensfit view {tmp_path / 'shoot.toml'}" in said
    assert "report.json" not in said


@pytest.mark.parametrize("more", [(), ("lens",)])
def test_a_plate_without_a_preset_before_it_is_told_what_comes_first(
    plate: Path, more: tuple[str, ...]
):
    assert f"lensfit view PRESET {plate}" in refused(plate, *more)


def test_a_plate_that_is_not_there_is_named(lens, tmp_path: Path):
    assert "no.exr" in refused(lens, tmp_path / "no.exr")


def test_a_port_that_is_taken_is_named(lens, plate):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert f"port {port} cannot be used" in refused(
            lens, plate, "--port", str(port)
        )


def test_without_the_extra_it_says_what_to_install(lens, plate, monkeypatch):
    monkeypatch.delitem(
        sys.modules, "lensfit.workflow.view.loopback_server", raising=False
    )
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert "pip install 'lensfit[view]'" in refused(lens, plate)


@contextmanager
def view_process(*words: str | Path) -> Iterator[Callable[..., dict]]:
    """Answers of a view that is a process; it must end with Ctrl-C."""
    started = ["view", *map(str, words), "--no-browser"]
    with subprocess.Popen(
        [sys.executable, "-c", "from lensfit.cli.main import main; main()", *started],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:")

        def ask(name: str, **message: object) -> dict:
            body = json.dumps(message).encode() if name != "lens" else None
            headers = {"Content-Type": "application/json"}
            asked = urllib.request.Request(f"{address}api/{name}", body, headers)
            with urllib.request.urlopen(asked) as answer:
                return json.load(answer)

        try:
            yield ask
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        assert process.stderr.read() == ""


@pytest.mark.slow
def test_the_process_answers_and_ends_with_ctrl_c(lens, plate):
    with view_process(lens, plate, "--depth-unit", "m") as ask:
        assert ask("lens")["width"] == 32
        assert ask("command")["command"].endswith("--out lens --depth-unit=m")


@pytest.mark.slow
def test_a_plate_of_a_scaled_camera_is_viewed_in_its_own_numbers(tmp_path: Path):
    """70 mm on 72 mm: the lens of 35 mm on 36 mm, everything twice as far away."""
    made = thin_lens_preset(ThinCamera(35.0, 2.0, 2.0, 36.0, 32, 18))
    save_preset(made, tmp_path / "thin.json")
    window = Window.of_size(32, 18)
    ones = np.ones((18, 32), np.float16)
    channels = {name: ones for name in "RGB"} | {"Z": 6 * ones}
    header = {"lens/focal": 70.0, "lens/fstop": 2.0, "lens/focus": 4.0}
    part = ExrPart(channels, window, window, header | {"lens/aperture": 72.0})
    write_exr(tmp_path / "plate.exr", ExrImage((part,)))
    words = (tmp_path / "thin.json", tmp_path / "plate.exr", "--depth-unit", "m")
    with view_process(*words) as ask:
        assert "--scale-to-sensor" in ask("lens")["error"]
    with view_process(*words, "--scale-to-sensor") as ask:
        start = ask("lens")
        assert start["error"] is None
        assert start["camera"]["focal_length_mm"] == pytest.approx(70)
        assert start["camera"]["focus_distance_mm"] == pytest.approx(4000)
        picked = ask("focus", x=16, y=9)["focus_distance_mm"]
        assert picked == pytest.approx(6000, abs=250)
        assert any("put on 70 mm on 72 mm" in n for n in ask("plan")["notes"])
        assert "--scale-to-sensor" in ask("command")["command"]


@pytest.mark.slow
def test_a_scaled_lens_is_viewed_by_itself(lens):
    words = (lens, "--focal-length-mm", "70", "--sensor-width-mm", "72")
    with view_process(*words, "--scale-to-sensor") as ask:
        (start,) = ask("lens")["lenses"]
        assert start["camera"]["focal_length_mm"] == 70
        assert start["camera"]["focus_distance_mm"] == pytest.approx(2 * 700)
        assert any("put on 70 mm on 72 mm" in n for n in ask("field")["notes"])
