"""Small traced shoots, and what goes wrong with them when people state or shoot them.

A 28 mm retrofocus lens by exact ray tracing: dots in focus, nearer and farther at two
f-numbers from one place, one tilted, and a line grid. Nothing is drawn by the model
that judges it.
"""

from dataclasses import replace
from pathlib import Path

from data_synth.prescription import load_prescription
from data_synth.sensor import Sensor
from data_synth.shoot import Camera, write_shoot
from data_synth.wavefront_cases import frame_for
from data_synth.wavefront_plan import WavefrontPlan, wavefront_shots

SIZE_PX = (640, 480)


def write_traced(folder: Path, lens: str = "nikkor_28", prefix: str = "") -> None:
    """The views of a lens, as linear 16-bit pictures.

    Parameters
    ----------
    lens : Put in place of the 28 mm lens, before the same charts at the same settings.
    prefix : Of the views' names.
    """
    planned = load_prescription("nikkor_28")
    frame = frame_for(planned, SIZE_PX)
    shots = wavefront_shots(planned, frame, WavefrontPlan(form="png16"))
    if prefix:
        shots = [replace(shot, name=prefix + shot.name) for shot in shots[:3]]
    write_shoot(folder, load_prescription(lens), Camera(frame, Sensor()), shots)
