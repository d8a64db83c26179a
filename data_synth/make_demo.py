"""Makes the bundled demo: `python -m data_synth.make_demo [FOLDER]`.

Six photographs by a retrofocus 28 mm with barrel distortion, lateral colour, fall-off
and coma: small holes lit from behind, in focus (EXR), focused nearer and farther, two
stops down, and tilted so that the focal length is determined (8-bit sRGB PNG); and a
line grid (JPEG). And one CG plate to put the lens on.
"""

import sys
from functools import partial
from pathlib import Path

from data_synth.chart import Chart, Pose
from data_synth.plate import write_plate
from data_synth.prescription import load_prescription
from data_synth.sensor import Frame, Sensor
from data_synth.shoot import Camera, Shot, write_shoot

FOLDER = Path(__file__).parent / "demo"
DOTS = Chart("dot-grid", pitch_mm=55.0, mark_mm=2.0)
LINES = Chart("line-grid", pitch_mm=80.0, mark_mm=3.5)
WIDE, STOPPED = 4.0, 8.0
FOCUS_MM, NEAR_MM, FAR_MM = 1500.0, 900.0, 4500.0
SQUARE = Pose(FOCUS_MM)
TILTED = Pose(
    1540.0, tilt_deg=14.0, pan_deg=-19.0, roll_deg=3.0, shift_mm=(25.0, -15.0)
)
OF_DOTS = partial(Shot, chart=DOTS, brightest=0.85, form="png")
SHOTS = [
    OF_DOTS("dots", pose=SQUARE, f_number=WIDE, focus_distance_mm=FOCUS_MM, form="exr"),
    OF_DOTS("dots_near", pose=SQUARE, f_number=WIDE, focus_distance_mm=NEAR_MM),
    OF_DOTS("dots_far", pose=SQUARE, f_number=WIDE, focus_distance_mm=FAR_MM),
    OF_DOTS("dots_stopped", pose=SQUARE, f_number=STOPPED, focus_distance_mm=NEAR_MM),
    OF_DOTS(
        "dots_tilted",
        pose=TILTED,
        f_number=WIDE,
        focus_distance_mm=FOCUS_MM,
        says_distance=False,
    ),
    Shot(
        "lines",
        LINES,
        Pose(FOCUS_MM, roll_deg=0.6, shift_mm=(11.0, 7.0)),
        WIDE,
        FOCUS_MM,
        form="jpg",
    ),
]


def make_demo(folder: Path = FOLDER) -> None:
    """Write the demo shoot and the plate into a folder."""
    camera = Camera(Frame((1280, 960), (28.0, 21.0)), Sensor(read_noise_e=2.0))
    prescription = load_prescription("nikkor_28")
    write_shoot(folder, prescription, camera, SHOTS, seed=20)
    write_plate(folder / "plate.0001.exr")


if __name__ == "__main__":
    make_demo(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
