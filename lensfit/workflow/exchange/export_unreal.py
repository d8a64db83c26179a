"""Unreal's lens file: OpenCV's five coefficients at every state."""

from dataclasses import replace

from lensfit.atomic import write_text_atomic
from lensfit.preset.exchange.unreal import UnrealState, unreal_text
from lensfit.printable import printable
from lensfit.workflow.exchange.export import (
    Exported,
    ExportRequest,
    Nearness,
    described,
    exported,
    opencv_camera,
)
from lensfit.workflow.exchange.export_tables import state_name, states_of

_COEFFICIENTS = 5
_PUPIL = "entrancePupilOffsetMm"


def export_unreal(request: ExportRequest) -> Exported:
    """A row for each entry, or for the one asked for."""
    states, nearness, pupils, lens = [], [], [], None
    for state in states_of(request):
        lens = replace(request, state=state).lens()
        camera, residual = opencv_camera(lens, request.frame, _COEFFICIENTS)
        states.append(UnrealState(camera, lens.focal_length_mm, lens.focus_distance_mm))
        nearness.append(Nearness(f"distortion at {state_name(lens)}", residual))
        pupils.append(f"{float(lens.entrance_pupil_offset_mm):.3f}")
    assert lens is not None
    name = printable(" ".join(request.preset.lens.name.split()))
    notes = {
        "madeBy": described(request, lens),
        "residual": "; ".join(map(str, nearness)),
        _PUPIL: "; ".join(pupils),
    }
    serial = request.preset.lens.serial
    write_text_atomic(request.out, unreal_text(states, name, serial, notes))
    found = exported(request, lens, tuple(nearness))
    place = (
        "the nodal offset is written as none: place the camera in the entrance pupil, "
        f"{pupils[-1]} mm in front of the sensor"
    )
    return Exported(found.paths, found.nearness, (*found.notes, place))
