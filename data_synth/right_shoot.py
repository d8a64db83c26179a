"""A small shoot as it should be: what the README asks for to measure the geometry.

One chart of dots that fills the frame, square to the camera and turned by 20 degrees
both ways, at two stops down from the widest; distances of square views are stated.
"""

import numpy as np

from data_synth.chart import Pose
from data_synth.frame import Frame
from data_synth.plan import chart_for
from data_synth.prescription import Prescription
from data_synth.shoot import Shot

_FOCAL_LENGTHS = (30.0, 60.0)
"""How far away the chart stands."""
_TILT_DEG = 20.0


def right_shots(prescription: Prescription, frame: Frame, seed: int) -> list[Shot]:
    """The views of the first focal length.

    Parameters
    ----------
    seed : Of the chart's distance, and of how exactly it stands.
    """
    rng = np.random.default_rng(seed)
    focal_mm = prescription.states[0].focal_length_mm
    distance_mm = round(focal_mm * float(rng.uniform(*_FOCAL_LENGTHS)), -1)
    chart = chart_for(prescription, frame, "dot-grid", focal_mm, distance_mm)
    stop = round(2 * prescription.f_number, 1)

    def pose(tilt_deg: float, pan_deg: float) -> Pose:
        error = rng.normal(0, 0.6, 3)
        roll = float(rng.uniform(-4, 4))
        return Pose(
            distance_mm, tilt_deg + float(error[0]), pan_deg + float(error[1]), roll
        )

    views = {
        "square": pose(0.0, 0.0),
        "square_again": pose(0.0, 0.0),
        "left": pose(0.0, -_TILT_DEG),
        "up": pose(_TILT_DEG, 0.0),
    }
    return [
        Shot(
            name,
            chart,
            where,
            stop,
            distance_mm,
            focal_length_mm=focal_mm,
            form="png16",
            says_distance=name.startswith("square"),
            from_maps=True,
        )
        for name, where in views.items()
    ]
