"""Two hundred slider moves while a calibration runs in the same process."""

import random
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from bundled_shoot import demo_in_focus
from view_makers import Client, plate_client, thin_lens, write_depth_plate

from lensfit.plate.apply_options import ApplyOptions
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.view.lens_adjustments import LensAdjustments
from lensfit.workflow.view.screen_picture import screen_png
from lensfit.workflow.view.viewed_plate import ViewedPlate

MOVES, HANDS = 200, 4
MOST_GROWTH_BYTES = 200e6
STATUS = Path("/proc/self/status")
STATES = [
    {"f_number": n, "focus_distance_mm": mm, "knobs": {"blades": blades}}
    for n in (2.0, 2.8, 4.0)
    for mm in (1500.0, 2200.0, "inf")
    for blades in (5, 7)
]


def memory_bytes() -> float:
    """Of this process, resident."""
    line = next(x for x in STATUS.read_text().splitlines() if x.startswith("VmRSS"))
    return 1024.0 * int(line.split()[1])


def moved(client: Client, state: int) -> bytes | None:
    """The picture of a state; None where a newer one took its place."""
    answer = client.post("render", newest=True, **STATES[state])
    assert answer.status in (200, 204), answer.content
    return answer.content if answer.status == 200 else None


def at_rest(client: Client, state: int) -> bytes:
    """As a page ends: it asks again where another came before."""
    while (picture := moved(client, state)) is None:
        pass
    return picture


@pytest.mark.slow
@pytest.mark.skipif(not STATUS.exists(), reason="the system does not tell its memory")
def test_slider_moves_while_a_calibration_runs(tmp_path: Path):
    plate = write_depth_plate(tmp_path / "plate.exr", 160, 90)
    preset, draw = thin_lens(160, 90), random.Random(20)
    moves = [draw.randrange(len(STATES)) for _ in range(MOVES)]
    shoot = demo_in_focus()
    calibrate(shoot, tmp_path / "first")  # programs are compiled, and kept in memory
    still = ViewedPlate(preset, str(plate), ApplyOptions())
    pictures = [
        screen_png(still.pixels(LensAdjustments(**one), "full")) for one in STATES
    ]
    assert len({*pictures}) == len(STATES)
    before, failed = memory_bytes(), list[BaseException]()
    is_over = threading.Event()

    def run() -> None:
        try:
            while not is_over.is_set():
                calibrate(shoot, tmp_path / "second")
        except BaseException as error:
            failed.append(error)

    with (
        plate_client(plate, preset) as client,
        ThreadPoolExecutor(HANDS) as hands,
    ):
        calibration = threading.Thread(target=run)
        calibration.start()
        seen = list(hands.map(lambda state: moved(client, state), moves))
        during = hands.map(lambda state: moved(client, state), moves[:HANDS])
        last = at_rest(client, moves[-1])
        list(during)
        is_over.set()
        calibration.join()
    assert failed == []
    assert (tmp_path / "second" / "preset.json").is_file()
    made = [(state, one) for state, one in zip(moves, seen, strict=True) if one]
    assert made
    assert all(one == pictures[state] for state, one in made)
    assert last == pictures[moves[-1]]
    assert memory_bytes() - before < MOST_GROWTH_BYTES
