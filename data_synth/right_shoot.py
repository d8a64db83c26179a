"""A small shoot as it should be: what the guide asks for to measure the geometry.

At each focal length, and at each place that the lens is focused at, a chart of dots
fills the frame: square to the camera, and turned by 20 degrees both ways. It is
photographed two stops down from the widest; distances of square views are stated.
"""

import numpy as np

from data_synth.chart import Pose
from data_synth.plan import chart_for
from data_synth.prescription import Prescription
from data_synth.sensor import Frame
from data_synth.shoot import Shot

_TILT_DEG = 20.0
_VIEWS = {
    "square": (0.0, 0.0),
    "left": (0.0, -_TILT_DEG),
    "up": (_TILT_DEG, 0.0),
    "square_again": (0.0, 0.0),
}


def right_shots(
    prescription: Prescription,
    frame: Frame,
    seed: int,
    *,
    distances: tuple[float, ...] = (40.0,),
    views: int = 4,
    every_focal_length: bool = False,
) -> list[Shot]:
    """The views of the first focal length, or of the first and the last.

    Parameters
    ----------
    seed : Of how exactly the chart stands.
    distances : Of the chart, on which the lens is focused, in focal lengths.
    views : At each of them, 4 at most.
    """
    rng = np.random.default_rng(seed)
    states = [*prescription.states[:1], *prescription.states[-1:]]
    states = (
        states if every_focal_length and len(prescription.states) > 1 else states[:1]
    )
    shots = []
    for state in states:
        for away in distances:
            focal_mm = state.focal_length_mm
            distance_mm = round(focal_mm * away, -1)
            chart = chart_for(prescription, frame, "dot-grid", focal_mm, distance_mm)
            for name, turn in list(_VIEWS.items())[:views]:
                tilt, pan = np.add(turn, rng.normal(0, 0.6, 2)).tolist()
                roll = float(rng.uniform(-4, 4))
                shot = Shot(
                    f"{name}_{focal_mm:g}mm_{distance_mm:g}mm".replace(".", "p"),
                    chart,
                    Pose(distance_mm, tilt, pan, roll),
                    round(2 * prescription.f_number, 1),
                    distance_mm,
                    focal_length_mm=focal_mm,
                    form="png16",
                    says_distance=name.startswith("square"),
                    from_maps=True,
                )
                shots.append(shot)
    return shots
