"""Makes the bundled demo: `python -m data_synth.make_demo [FOLDER]`.

Three photographs by a retrofocus 28 mm with barrel distortion, lateral colour and
fall-off: dots straight on (EXR), the same dots tilted (8-bit sRGB PNG) so that the
focal length is determined, and a line grid (JPEG); and one CG plate to put the lens on.
"""

import sys
from pathlib import Path

from data_synth.chart import Chart, Pose
from data_synth.frame import Frame
from data_synth.plate import write_plate
from data_synth.prescription import load_prescription
from data_synth.sensor import Sensor
from data_synth.shoot import Camera, Shot, write_shoot

FOLDER = Path(__file__).parent / "demo"
DOTS = Chart("dot-grid", pitch_mm=55.0, mark_mm=4.0)
LINES = Chart("line-grid", pitch_mm=80.0, mark_mm=3.5)
SHOTS = [
    Shot("dots", DOTS, Pose(1500.0), 4.0, 1500.0, form="exr"),
    Shot(
        "dots_tilted",
        DOTS,
        Pose(
            1540.0, tilt_deg=14.0, pan_deg=-19.0, roll_deg=3.0, shift_mm=(25.0, -15.0)
        ),
        4.0,
        1500.0,
        form="png",
        says_distance=False,
    ),
    Shot(
        "lines",
        LINES,
        Pose(1500.0, roll_deg=0.6, shift_mm=(11.0, 7.0)),
        4.0,
        1500.0,
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
