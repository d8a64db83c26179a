"""A camera shader for Cycles: the whole lens, ray by ray."""

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.fitting.exchange.ray_series import fit_ray_series
from lensfit.lens import Lens
from lensfit.preset.exchange.cycles_osl import cycles_osl_text
from lensfit.workflow.exchange.export import (
    Exported,
    ExportRequest,
    Nearness,
    described,
    exported,
)

_USE = """\
In Blender 4.5 or later: render with Cycles (processor or OptiX), set the camera's lens
type to Custom and choose this file. Its place is the entrance pupil, {pupil:.2f} mm
in front of the sensor. Frame: {frame}, {width:g} mm wide, at f/{stop:g}; another
f-number or focus distance is another export."""


def export_cycles(request: ExportRequest) -> Exported:
    """The shader of the lens at its state.

    Raises
    ------
    ExchangeError : The f-number is not known.
    """
    lens, frame = request.lens(), request.frame
    if lens.f_number is None:
        raise ExchangeError(
            "rays through the pupil need an f-number",
            where=request.preset.lens.name,
            remedy="give --f-number",
        )
    made, judged = fit_ray_series(lens, frame)
    nearness = (
        Nearness("distortion", judged.chief),
        Nearness("rays, from infinity to half the focus distance", judged.rays),
        Nearness("fall-off", worst_light=judged.worst_light),
    )
    use = _USE.format(
        pupil=float(lens.entrance_pupil_offset_mm),
        frame=frame,
        width=frame.sensor_width_mm,
        stop=lens.f_number,
    )
    label = "\n".join([described(request, lens), *map(str, nearness), use])
    write_text_atomic(request.out, cycles_osl_text(made, label))
    found = exported(
        request, lens, nearness, has_colour=True, has_light=True, has_blur=True
    )
    return Exported(found.paths, found.nearness, (*found.notes, *_left_out(lens)))


def _left_out(lens: Lens) -> list[str]:
    notes = ["a path tracer's rays do not diffract"]
    if lens.blur is None:
        notes.append("the blur was not measured: a perfect lens' is written")
    elif lens.blur.transmission is not None:
        notes.append("the shader holds no ring brightness and no filter of the stop")
    return notes
