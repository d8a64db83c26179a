"""The stages that `lensfit apply` would run on a plate, with their cost."""

from pathlib import Path

from lensfit.errors import ImageError
from lensfit.io.exr import read_exr
from lensfit.io.exr_deep import is_deep
from lensfit.io.sequence import expand_frames
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.flat_plate import plate_in_depth
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.plate_notes import left_out_knobs
from lensfit.plate.plate_file import colour_layers, plate_views
from lensfit.preset.schema import Preset
from lensfit.progress import Progress, silent
from lensfit.rendering.look.stack import light_spreads
from lensfit.rendering.render_plan import Plan, plan_of

_STEPS = 3
"""Reading, maps, blur."""


def plan_plate(
    preset: Preset,
    plates: str | Path,
    options: ApplyOptions,
    progress: Progress = silent,
    *,
    cores: int | None = None,
) -> tuple[Plan, list[str]]:
    """The plan of one plate, and what was assumed.

    Parameters
    ----------
    plates : An EXR file, or a pattern such as ``plate.####.exr``, of which the first
        frame is planned.
    cores : That render it; those of this process if None.
    progress : Called for the plate, its maps and its blur, in this order.

    Raises
    ------
    ImageError : The plate cannot be read, holds no colour, or is deep; no frame exists.
    """
    number, plate = expand_frames(plates)[0]
    if is_deep(plate):
        raise ImageError(
            "is a deep plate, which can only be planned flat",
            where=plate,
            remedy='render it with "lensfit apply", which takes deep plates',
        )
    progress("plan", 0, _STEPS)
    lens = PlateLens(preset, options)
    lens.notes.add(*left_out_knobs(options.switches, options.knobs))
    if number is not None:
        lens.notes.add(f"the plan is that of the first frame, {plate.name}")
    first, *others = plate_views(read_exr(plate), plate)
    if others:
        lens.notes.add(f"the plan is that of view {first.view.name!r}")
    image = first.view.image
    state = lens.noted_state(first.header, plate)
    for part in image.parts:
        if not colour_layers(part, options.layers):
            continue
        window = options.written(part.data_window, part.display_window)
        found = plate_in_depth(lens, part, state, image, plate)
        if found is not None or light_spreads(state.knobs.look):
            display, blurs = part.display_window, found is not None
            reach = lens.reach(window, part.data_window, display, blurs=blurs)
        else:
            reach = window
        progress("plan", 1, _STEPS)
        stages = lens.stages_for(state, part.display_window, reach)
        progress("plan", 2, _STEPS)
        plan = plan_of(
            stages,
            window,
            options.tolerance,
            depth_mm=found and found.seen_depth_mm,
            cores=cores,
        )
        return plan, lens.notes.said
    raise ImageError(
        "holds no R, G, B to render", where=plate, remedy="give a colour plate"
    )
