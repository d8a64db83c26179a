"""One plate through a lens, from file to finished frame: the order of operations.

kind of plate       a flat one (`flat_plate`), a deep one, which is returned flat
                    (`deep_plate`), or a picture that explains (`explaining_picture`)
camera state        from all its sources (`camera.sources`, `camera.plate_state`)
depth, objects      of the plate, if it has any (`plate.depth`, `plate.mattes`)
maps, gains, blur   of the lens, kept while the camera stays (`plate_lens`)
colour layers       rendered; every other channel keeps its bits
window              a plate may have overscan (a data window larger than the display
                    window); the display window is written, unless it is kept
header              says what was done (`signature`)
"""

from pathlib import Path
from typing import final

from msgspec.structs import replace

from lensfit.errors import ImageError
from lensfit.io.depth import unit_in_mm
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_deep import is_deep
from lensfit.preset.knobs import NEUTRAL, not_neutral
from lensfit.preset.schema import Preset
from lensfit.preset.turned_pupil import filter_at_all_sizes
from lensfit.workflow.apply_options import ApplyOptions
from lensfit.workflow.frame.deep_plate import render_deep
from lensfit.workflow.frame.explaining_picture import explaining_picture
from lensfit.workflow.frame.flat_plate import render_flat
from lensfit.workflow.frame.left_out_knobs import left_out_knobs
from lensfit.workflow.frame.plate_check import check_options
from lensfit.workflow.frame.plate_lens import PlateLens
from lensfit.workflow.frame.signature import SAID
from lensfit.workflow.plate.header import plate_header


@final
class FrameRenderer:
    """Renders frames; keeps what it knows about the lens while the camera stays.

    Raises
    ------
    LensfitError : An option cannot be followed, whatever the plate.
    """

    def __init__(self, preset: Preset, options: ApplyOptions):
        self.options = options
        _check_for_all_plates(options)
        self.lens = PlateLens(preset, options)
        self.lens.notes.add(*left_out_knobs(options.switches, options.knobs))

    @property
    def notes(self) -> list[str]:
        """What was assumed, left out or seen so far, each once."""
        return list(self.lens.notes.said)

    def render(self, path: Path) -> ExrImage:
        """One finished frame."""
        if self.options.output != "result":
            return explaining_picture(self.lens, path)
        if is_deep(path):
            return render_deep(self.lens, path)
        return render_flat(self.lens, read_exr(path), path)

    def finished(self, plate: Path, target: Path) -> tuple[ExrPart, ...]:
        """The headers of the frame that is there already; none where it must be
        rendered. Notes when it is not what would be rendered now, and when only a
        damaged one is there, as a full disk or a cut copy leaves.

        Raises
        ------
        ImageError : The system does not let it be read.
        LensfitError : It could not be rendered now: the plate has not what the options
            name, or the lens cannot be turned like that.
        """
        if not target.is_file():
            return ()
        try:
            parts = read_exr(target, header_only=True).parts
        except ImageError as error:
            if isinstance(error.__cause__, OSError):
                raise
            self.lens.notes.add(f"{target} was damaged and is rendered again")
            return ()
        self._note_if_made_otherwise(plate, parts)
        return parts

    def _note_if_made_otherwise(self, plate: Path, parts: tuple[ExrPart, ...]) -> None:
        header = plate_header(plate)
        state = self.lens.state_of(header, plate)
        if not is_deep(plate):
            check_options(self.options, header, plate)
        if not_neutral(replace(state.knobs, look=NEUTRAL.look)):
            self.lens.lens_at(state)
        wanted = self.lens.signature(state)
        made = next((p.attributes[SAID] for p in parts if SAID in p.attributes), None)
        if made != wanted:
            self.lens.notes.add(
                "some frames were finished before with other settings or by an older "
                "preset, and were kept (--overwrite renders them again)"
            )


def _check_for_all_plates(options: ApplyOptions) -> None:
    """Refuse what no plate can change."""
    filter_image = options.knobs.get("filter_image")
    if isinstance(filter_image, str):
        filter_at_all_sizes(filter_image)
    if options.depth.unit is not None:
        try:
            unit_in_mm(options.depth.unit)
        except ImageError as error:
            what = f"{error.what} (--depth-unit)"
            raise ImageError(what, remedy=error.remedy) from None
