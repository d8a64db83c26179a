"""Times, profiles and floors of benchmarks against what is known beforehand."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest

from data_synth.bench.detect import agreement, misnumbered
from data_synth.bench.fit.benchmark import pass_flops
from data_synth.bench.floor import Floor, Rates, fft_flops, measured_rates
from data_synth.bench.render.profile import blur_floor, warp_bytes
from data_synth.bench.render.scenes import synthetic_scene
from data_synth.bench.result import bench_result, machine
from data_synth.bench.sampler import sampled
from data_synth.bench.start import start_rows
from data_synth.bench.times import timed
from data_synth.commands.bench.tables import profile_tables
from lensfit.cli._terminal import console
from lensfit.errors import LensfitError
from lensfit.preset.thin_lens import ThinCamera
from lensfit.rendering.look.ghosting import disc_kernel


def test_a_profile_sums_to_the_time_and_names_the_file_at_work():
    def work():
        began = time.perf_counter()
        while time.perf_counter() - began < 0.4:
            disc_kernel(120.0, 60)
        return "done", time.perf_counter() - began

    (said, spent), seconds = sampled(work)
    assert said == "done"
    assert next(iter(seconds)) == "rendering/look/ghosting"
    assert sum(seconds.values()) == pytest.approx(spent, rel=0.2)


def test_a_profile_ends_with_an_error_of_the_work():
    with pytest.raises(ZeroDivisionError):
        sampled(lambda: 1 / 0)


def test_the_first_run_is_apart_from_the_steady_state():
    naps = iter([0.2, 0.02, 0.02, 0.02])
    _, times = timed(lambda: time.sleep(next(naps)), 4)
    assert times.first_s > 0.19
    assert 0.015 < times.steady_s < 0.15
    assert times.cpu_s < times.first_s
    assert times.spread_s >= 0


def test_distance_from_the_floor():
    floor = Floor("copy", needs=2e9, unit="bytes", rate=1e9, seconds=6.0)
    assert floor.distance == 3.0
    assert floor.as_table()["floor_s"] == 2.0


def test_rates_of_a_machine_are_those_of_any_that_computes():
    rates = measured_rates()
    assert 1e8 < rates.bytes < 1e13
    assert 1e8 < rates.flops < 1e15
    assert 1e7 < rates.fft_flops < 1e15


def test_operations_of_known_sizes():
    # J^T J of one shared parameter and none of the photograph's: r^2 of two rows.
    assert pass_flops(1, shared=1, local=0) == 4.0
    assert pass_flops(10, shared=3, local=2) == 10 * pass_flops(1, 3, 2)
    assert fft_flops(3, 2) == 3 * 2.5 * 4 * 2


def test_every_result_names_its_machine_and_is_written(tmp_path):
    result = bench_result("warp", machine(), tmp_path, rows=[])
    assert result["machine"]["cores"] >= 1
    assert json.loads((tmp_path / "bench_warp.json").read_text()) == result


LATTICE = np.stack(np.meshgrid(np.arange(6), np.arange(4)), -1).reshape(-1, 2)


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("flip", [1, -1])
def test_a_turned_shifted_lattice_is_numbered_alike(turns, flip):
    turn = np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), turns)
    other = LATTICE @ turn @ np.diag([1, flip]) + (7, -3)
    assert misnumbered(LATTICE, other) == 0
    other[5] += (1, 0)
    assert misnumbered(LATTICE, other) == 1


def test_marks_are_compared_one_by_one(tmp_path):
    class Found:
        points_px = LATTICE * 20.0 + 0.5
        lattice = LATTICE

        def __len__(self):
            return len(LATTICE)

    points = np.vstack([LATTICE[:-2] * 20.0 + (0.1, 0), [[900.0, 900.0]]])
    places = np.vstack([LATTICE[:-2], [[50, 50]]])
    path = tmp_path / "points.npz"
    np.savez(path, px=points, idx=places, view=np.zeros(len(points), int))
    agreed = agreement(Found(), path)  # pyright: ignore[reportArgumentType]
    assert agreed is not None
    assert agreed.recall == pytest.approx(22 / 23)
    assert agreed.apart_px == pytest.approx(0.1)
    assert (agreed.misnumbered, agreed.more) == (0, 2)


def test_tables_show_stages_and_distance():
    floor = Floor("copy", 2e9, "bytes", 1e9, 6.0).as_table() | {"set": "HD"}
    result = {
        "profiles": {"a": {"rendering/warp": 9.0, "rendering/disc": 0.01}},
        "floors": [floor],
    }
    screen = console()
    with screen.capture() as printed:
        for table in profile_tables(result):
            screen.print(table)
    text = printed.get()
    assert "rendering/warp" in text
    assert "rendering/disc" not in text
    assert "2e+09 bytes" in text
    assert profile_tables({"rows": []}) == []


def test_a_warp_moves_what_it_reads_and_writes():
    # One pixel of four channels: 16 bytes in, 16 out, 8 of the map.
    assert warp_bytes(1, 4) == 40.0


def test_transforms_of_a_frame_are_those_of_its_tiles():
    camera = ThinCamera(50.0, 2.0, 2.0, 24.0, 256, 144)
    scene = synthetic_scene(camera, 256, 144)
    rates = Rates(bytes=1e9, flops=1e9, fft_flops=1e9)
    floor = blur_floor(scene, 1.0, rates)
    # Colours, alpha, map and distance read, colours and alpha written, 4 bytes each.
    assert floor.needs == 4 * 11 * 256 * 144
    assert floor.distance == pytest.approx(1e9 / floor.needs)


def test_a_process_of_its_own_that_fails_is_one_line(tmp_path):
    with pytest.raises(LensfitError, match="in a process of its own, failed"):
        start_rows("render", tmp_path)


@pytest.mark.slow
def test_import_compilation_first_run_and_steady_state_are_told_apart(data_dir):
    rows = {row.what: row.value for row in start_rows("render", data_dir / "plates")}
    kinds = ["import", "compilation", "first run of a process", "steady state"]
    assert all(rows[f"{kind}, s"] > 0 for kind in kinds)


def test_the_import_that_is_timed_is_one_that_a_user_pays(tmp_path):
    """Nothing is drawn when a plate is rendered."""
    asked = (
        "import sys; from pathlib import Path;"
        "from lensfit.errors import PresetError;"
        "from data_synth.bench.start_job import _render\n"
        "try: _render(Path(sys.argv[1]))\n"
        "except PresetError: print(sorted({'matplotlib', 'skimage'} & {*sys.modules}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", asked, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "[]\n"
