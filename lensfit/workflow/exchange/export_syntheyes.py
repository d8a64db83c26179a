"""SynthEyes' lens information: a table of radii."""

import math

from lensfit.atomic import write_text_atomic
from lensfit.fitting.exchange.radial_table_fit import fit_radial_table
from lensfit.fitting.exchange.samples import residual_of
from lensfit.preset.exchange.syntheyes import LniNotes, syntheyes_text
from lensfit.printable import printable
from lensfit.workflow.exchange.export import (
    Exported,
    ExportRequest,
    Nearness,
    described,
    exported,
    principal_point,
    samples_pair,
)


def export_syntheyes(request: ExportRequest) -> Exported:
    """The table of one state, in millimetres."""
    lens, frame = request.lens(), request.frame
    fit, judge = samples_pair(lens, frame)
    x, y = principal_point(lens)
    made = fit_radial_table(fit, (x, y))
    residual = residual_of(made, judge)
    focus = lens.focus_distance_mm
    notes = LniNotes(
        focal_length_mm=lens.focal_length_mm,
        principal_distance_mm=float(lens.distortion.principal_distance_mm),
        centre_x_mm=x,
        centre_y_mm=y,
        sensor_width_mm=frame.sensor_width_mm,
        width_px=frame.size_px[0],
        height_px=frame.size_px[1],
        focus_distance_mm=None if focus is None or math.isinf(focus) else focus,
    )
    name = printable(" ".join(request.preset.lens.name.split()))
    comments = (described(request, lens), f"residual {residual} over {frame}")
    write_text_atomic(request.out, syntheyes_text(made, name, notes, comments))
    found = exported(request, lens, (Nearness("distortion", residual),))
    right, down = x / frame.pitch_mm, y / frame.pitch_mm
    centre = (
        "SynthEyes' table knows no centre: set that of the lens "
        f"{right:.2f} px right and {down:.2f} px down of the middle"
    )
    return Exported(found.paths, found.nearness, (*found.notes, centre))
