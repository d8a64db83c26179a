"""What `lensfit apply` would do to a plate, and at what cost; nothing is rendered."""

from pathlib import Path

from lensfit.errors import ImageError
from lensfit.io.exr import read_exr
from lensfit.io.exr_deep import is_deep
from lensfit.preset.schema import Preset
from lensfit.render.frame import window_with_margin
from lensfit.render.plan import Plan, plan_of
from lensfit.workflow.frame_renderer import ApplyOptions, FrameRenderer
from lensfit.workflow.plate import colour_layers


def plan_plate(
    preset: Preset, plate: Path, options: ApplyOptions
) -> tuple[Plan, list[str]]:
    """The plan of one plate, and what was assumed.

    Raises
    ------
    ImageError : The plate cannot be read, holds no colour, or is deep.
    """
    if is_deep(plate):
        raise ImageError(
            "is a deep plate, which can only be planned flat",
            where=plate,
            remedy='render it with "lensfit apply", which takes deep plates',
        )
    renderer = FrameRenderer(preset, options)
    image = read_exr(plate)
    state = renderer.noted_state(image)
    for part in image.parts:
        if not colour_layers(part, options.layers):
            continue
        window = part.data_window if options.keep_overscan else part.display_window
        depth, _ = renderer.depth_of(part, state, image, plate)
        if depth is not None:
            reach = window_with_margin(window, part.data_window)
        else:
            reach = window
        stages = renderer.stages_for(state, part.display_window, reach)
        plan = plan_of(stages, window, options.tolerance, depth_mm=depth)
        return plan, renderer.notes
    raise ImageError(
        "holds no R, G, B to render", where=plate, remedy="give a colour plate"
    )
