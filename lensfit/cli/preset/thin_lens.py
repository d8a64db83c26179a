"""`lensfit preset thin-lens`: an ideal lens, as a CG renderer has it."""

from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._console import say_line


def thin_lens(
    camera: Annotated[Path, typer.Argument(help="camera.json of a CG renderer")],
    out: Annotated[Path, typer.Option("--out", help="Preset to write")],
) -> None:
    """Make an ideal lens: defocus and nothing else, as a CG renderer's thin lens.

    The file states focal_length_mm, f_number, focus_distance_m (from the lens),
    sensor_width_mm, width_px and height_px.

    Example: lensfit preset thin-lens camera.json --out thin.json
    """
    from lensfit._strict import convert_strictly, read_json_object
    from lensfit.errors import PresetError
    from lensfit.preset.store import save_preset
    from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset

    tables = read_json_object(
        camera,
        error=PresetError,
        source="give the camera.json of the plate",
        mend="mend the file",
    )
    stated = convert_strictly(tables, ThinCamera, error=PresetError, where=camera)
    save_preset(thin_lens_preset(stated), out)
    say_line(f"{out}: thin lens {stated.focal_length_mm:g} mm f/{stated.f_number:g}")
