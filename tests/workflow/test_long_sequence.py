"""A long sequence with animated focus and zoom: as fast, as small, and never lost."""

import itertools
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import msgspec
import numpy as np
import pytest
from plate_makers import make_preset, sharp

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.frame_outcome import apply_frame
from lensfit.plate.frame.renderer import FrameRenderer
from lensfit.preset.schema import Preset
from lensfit.preset.store import save_preset
from lensfit.workflow.apply import apply

DISPLAY = Window.of_size(160, 90)
DATA = DISPLAY.grown(24, 14)
NEW_PROGRAM = "/jax/core/compile/backend_compile_duration"


def zoom_preset() -> Preset:
    """Three focal lengths at three focus distances each, breathing."""
    preset = make_preset(24.0, 35.0, 70.0)
    entries = tuple(
        msgspec.structs.replace(
            entry,
            focus_distance_mm=focus_mm,
            projection=msgspec.structs.replace(
                entry.projection,
                principal_distance_mm=entry.focal_length_mm
                * (1 + entry.focal_length_mm / focus_mm),
            ),
        )
        for entry in preset.entries
        for focus_mm in (500.0, 2000.0, float("inf"))
    )
    return msgspec.structs.replace(preset, entries=entries)


def write_frame(path: Path, share: float, depth: bool) -> Path:
    """A plate at a share of a zoom from 24 to 70 mm and a rack from .5 m to 5 m."""
    x, y = np.moveaxis(DATA.pixel_centres(), -1, 0)
    waves = [np.sin(x / 7 + share), np.cos(y / 6), np.sin((x + y) / 9)]
    channels = {
        n: (1 + w / 2).astype(np.float32) for n, w in zip("RGB", waves, strict=True)
    }
    if depth:
        channels["Z"] = (1 + np.abs(x) / 30).astype(np.float32)
    header = {
        "lens/focal": 24 + 46 * share,
        "lens/fstop": 2.8,
        "lens/focus": 1 / (2 - 1.8 * share),
        "lens/aperture": 36.0,
    }
    write_exr(path, ExrImage((ExrPart(channels, DATA, DISPLAY, header),)))
    return path


class Watch:
    """Programs compiled, processor time and memory, frame by frame."""

    def __init__(self):
        self.compiled = 0
        self.history: list[tuple[int, float, float]] = []

    def __enter__(self):
        jax.monitoring.register_event_duration_secs_listener(self._heard)
        return self

    def __exit__(self, *error):
        jax.monitoring.unregister_event_duration_listener(self._heard)

    def _heard(self, name: str, seconds: float, **facts) -> None:
        self.compiled += name == NEW_PROGRAM

    def frame_done(self, seconds: float) -> None:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        memory = pages * os.sysconf("SC_PAGE_SIZE") / 2**20
        self.history.append((self.compiled, seconds, memory))


def run(tmp_path: Path, frames: int, depth: bool) -> np.ndarray:
    """Programs so far, seconds of the processor and MiB, for each frame."""
    renderer = FrameRenderer(zoom_preset(), sharp() if not depth else ApplyOptions())
    target = tmp_path / "result.exr"
    with Watch() as watch:
        for number in range(frames):
            plate = write_frame(tmp_path / "plate.exr", number / (frames - 1), depth)
            start = time.process_time()
            outcome = apply_frame(renderer, plate, target)
            assert outcome.failure is None
            watch.frame_done(time.process_time() - start)
            target.unlink()
    assert len(renderer.notes) < 5
    return np.array(watch.history)


needs_statm = pytest.mark.skipif(
    not Path("/proc/self/statm").exists(), reason="needs /proc"
)


@needs_statm
@pytest.mark.parametrize("depth", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_no_frame_compiles_what_the_first_frames_compiled(tmp_path, depth):
    compiled = run(tmp_path, 16, depth)[:, 0]
    assert compiled[0] > 0  # else the watch hears nothing
    # Blur that grows may come to a larger tile; every other program is there.
    assert compiled[-1] - compiled[2] <= (3 if depth else 0)


@needs_statm
@pytest.mark.parametrize(
    ("depth", "frames"),
    [
        pytest.param(False, 1000, marks=pytest.mark.hard),
        pytest.param(True, 300, marks=pytest.mark.slow),
    ],
)
def test_a_long_sequence_keeps_its_speed_and_memory(tmp_path, depth, frames):
    compiled, seconds, memory = run(tmp_path, frames, depth).T
    part = frames // 10
    early, late = slice(part, 2 * part), slice(-part, None)
    assert np.median(seconds[late]) < 1.5 * np.median(seconds[early])
    assert memory[late].max() < memory[early].max() + 40
    assert compiled[-1] - compiled[part] <= (5 if depth else 0)


def test_apply_follows_animated_focus_and_zoom(tmp_path):
    """Each frame is what it would be alone, and neighbours differ by a step."""
    for number in range(5):
        write_frame(tmp_path / f"plate.{number:04d}.exr", number / 4, depth=False)
    preset = zoom_preset()
    whole = apply(
        preset, tmp_path / "plate.####.exr", tmp_path / "whole", options=sharp()
    )
    assert whole.failures == []
    pictures = []
    for path in whole.written:
        alone = apply(preset, tmp_path / path.name, tmp_path / "alone", options=sharp())
        assert path.read_bytes() == alone.written[0].read_bytes()
        pictures.append(read_exr(path).parts[0].channels["G"])
    steps = [np.abs(b - a).mean() for a, b in itertools.pairwise(pictures)]
    assert min(steps) > 1e-3
    assert max(steps) < 0.2


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs process groups")
@pytest.mark.parametrize("workers", [1, 2])
def test_killed_at_any_instant_it_ends_with_the_same_files(tmp_path, workers):
    frames = 12
    for number in range(frames):
        share = number / (frames - 1)
        write_frame(tmp_path / f"plate.{number:04d}.exr", share, depth=True)
    save_preset(zoom_preset(), tmp_path / "preset.json")
    out = tmp_path / "out"

    def job(folder: Path) -> subprocess.Popen:
        script = "from lensfit.cli.main import main; main()"
        words = [sys.executable, "-c", script, "apply", tmp_path / "preset.json"]
        words += [tmp_path / "plate.####.exr", "--out", folder, "--workers", workers]
        return subprocess.Popen(
            [str(w) for w in words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    start = time.monotonic()
    assert job(tmp_path / "whole").wait() == 0
    whole_s = time.monotonic() - start
    rng = random.Random(workers)
    for turn in range(6):
        running = job(out)
        time.sleep(rng.uniform(0.3, 1.0) * whole_s)
        if turn % 2:
            os.killpg(running.pid, signal.SIGKILL)
        else:
            running.kill()  # its workers go on until they notice
        running.wait()
    assert job(out).wait() == 0
    deadline = time.monotonic() + 60
    while list(out.glob(".*")) and time.monotonic() < deadline:
        time.sleep(0.1)
    contents = [
        {p.name: p.read_bytes() for p in sorted(folder.iterdir())}
        for folder in (out, tmp_path / "whole")
    ]
    assert contents[0] == contents[1]
