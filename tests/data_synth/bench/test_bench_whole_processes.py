"""Whole processes: their time and memory by the operating system's own accounting."""

import numpy as np
import pytest

from data_synth.bench.render.whole_processes import Bars, Spent, spent_on
from lensfit.errors import LensfitError
from lensfit.io.exr import read_exr
from lensfit.preset.store import save_preset
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset

THIN = thin_lens_preset(ThinCamera(50.0, 2.0, 2.0, 36.0, 96, 54))


@pytest.mark.slow
def test_frames_of_a_pull_are_rendered_each_with_its_own_focus(tmp_path):
    """And the memory of the one that measures does not count: a system may state what
    the starting process held as what the started one did."""
    save_preset(THIN, tmp_path / "preset.json")
    ballast = np.ones(2**28)  # 2 GiB, more than such frames need
    spent = spent_on(tmp_path, THIN, (96, 54), frames=2)
    assert ballast[-1] == 1
    frames = sorted((tmp_path / "out").glob("*.exr"))
    assert len(frames) == 2
    focus = [read_exr(path).parts[0].attributes["focus"] for path in frames]
    assert focus[1] > focus[0]
    assert spent.cpu_seconds > 0.1
    assert 0.05 < spent.memory_gib < 1.5


def test_a_process_that_fails_is_an_error_with_its_last_line(tmp_path):
    (tmp_path / "preset.json").write_text("{}")
    with pytest.raises(LensfitError, match=r"lensfit apply failed \(.*preset"):
        spent_on(tmp_path, THIN, (96, 54))


def test_rows_are_of_a_frame_and_memory_of_the_process():
    spent = Spent(48.0, 60.0, 1.5)
    seconds, memory = spent.rows("lens", "what", Bars(4.0, 2.0, 1.0), frames=24)
    assert (seconds.value, seconds.passed) == (2.0, True)
    assert seconds.peers == {"processor, s": 2.5}
    assert (memory.value, memory.passed) == (1.5, False)
