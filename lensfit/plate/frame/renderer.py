"""Render one plate through a lens, from file to finished frame, in this order.

views               of a stereo plate, each separately (`plate_views`)
kind of plate       a flat one (`flat_plate`), a deep one, which is returned flat
                    (`deep_plate`), or a picture that explains (`explaining_picture`)
camera state        from all its sources (`camera.sources`, `camera.plate_state`)
depth, objects      of the plate, if it has any (`plate_depth`, `plate_mattes`)
maps, gains, blur   of the lens, kept while the camera stays (`plate_lens`)
colour layers       rendered, or straightened (`straight_plate`); every other channel
                    keeps its bits
window              a plate may have overscan (a data window larger than the display
                    window); the display window is written, unless it is kept
header              a line on the operations (`signature`), digests of the inputs
                    (`fingerprint`) and of the file itself (`write_with_digest`)
"""

from dataclasses import replace
from pathlib import Path
from typing import final

from lensfit.errors import ImageError, OutputError
from lensfit.io.decoding import refuse_beyond_memory
from lensfit.io.depth_channel import unit_in_mm
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_deep import is_deep
from lensfit.io.exr_header import MAGIC
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.deep_plate import render_deep
from lensfit.plate.frame.explaining_picture import explaining_picture
from lensfit.plate.frame.flat_plate import render_flat
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.plate_notes import left_out_knobs
from lensfit.plate.frame.provenance import (
    FINGERPRINT,
    Fingerprint,
    is_made_here,
    is_whole,
)
from lensfit.plate.frame.straight_plate import PlateStraightener
from lensfit.plate.notes import FrameNote
from lensfit.plate.plate_file import (
    PlateView,
    joined_plate_views,
    one_focus_note,
    plate_views,
)
from lensfit.preset.adjusted_pupil import filter_at_all_sizes
from lensfit.preset.schema import Preset

_WORKING_BYTES_PER_PX, _STRAIGHT_BYTES_PER_PX = 100, 50
"""Besides the plate's own channels, to put the lens on and to take it off; measured
without depth of field, whose tiles do not grow with the plate."""
_HEAD_BYTES = 1 << 16
"""In which an OpenEXR file has its header."""
_LEAST_BYTES = 512
"""Of an OpenEXR file that has a picture."""


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
        self._straightener = PlateStraightener(self.lens)
        self.lens.notes.add(*left_out_knobs(options.switches, options.knobs))

    @property
    def notes(self) -> list[str]:
        """What was assumed, left out or seen so far, each once."""
        return list(self.lens.notes.said)

    def render(self, path: Path) -> ExrImage:
        """One finished frame.

        Raises
        ------
        ImageError : A deep plate is to be straightened.
        LensfitError : The plate cannot be rendered.
        """
        straight = self.options.output == "undistorted"
        if self.options.output != "result" and not straight:
            return explaining_picture(self.lens, path)
        if is_deep(path):
            if straight:
                raise ImageError(
                    "is a deep plate, and a photograph is not",
                    where=path,
                    remedy="give the photographed plate",
                )
            return render_deep(self.lens, path)
        image = read_exr(path, working_bytes_per_px=self._working_bytes_per_px)
        return self.render_read(image, path)

    def render_read(self, image: ExrImage, path: Path) -> ExrImage:
        """One finished frame of a flat plate that was read before.

        Parameters
        ----------
        image : The plate; its samples are left as they are.
        path : Its file, whose place and name say which settings hold.

        Raises
        ------
        LensfitError : The plate cannot be rendered.
        """
        largest_px = max(part.data_window.area for part in image.parts)
        refuse_beyond_memory(self._working_bytes_per_px * largest_px, path)
        views, made = plate_views(image, path), []
        for one in views:
            self.lens.notes.add(one.note)
            with one.named_errors(path):
                made.append(self._rendered_view(one, path))
        if len(views) > 1 and self.options.camera.focus_at is not None:
            self.lens.notes.add(one_focus_note(views, path))
        return joined_plate_views(image, views, made)

    @property
    def _working_bytes_per_px(self) -> int:
        straight = self.options.output == "undistorted"
        return _STRAIGHT_BYTES_PER_PX if straight else _WORKING_BYTES_PER_PX

    def _rendered_view(self, one: PlateView, path: Path) -> ExrImage:
        """One view."""
        plate = one.view.image, path, one.header, one.picked_in
        if self.options.output == "undistorted":
            return self._straightener.render(*plate)
        return render_flat(self.lens, *plate)

    def fingerprint(self, path: Path) -> Fingerprint:
        """What the frame of a plate would be made of now.

        Raises
        ------
        LensfitError : The plate cannot be read or carries a lens already, or its camera
            state is not known.
        """
        return self.lens.fingerprint(path)

    def finished(
        self, plate: Path, target: Path, wanted: Fingerprint
    ) -> tuple[ExrPart, ...]:
        """The headers of the frame that is there already, if it is what would be
        rendered now; none where it must be rendered, which is noted.

        Parameters
        ----------
        wanted : What the frame would be made of now.

        Raises
        ------
        ImageError : The system does not let it be read.
        OutputError : What is there is no frame of lensfit, or was made otherwise and is
            to be kept.
        """
        if not target.is_file():
            return ()
        try:
            parts = read_exr(target, header_only=True).parts
        except ImageError as error:
            if isinstance(error.__cause__, OSError):
                raise
            if not _begins_as_ours(target):
                raise _foreign_frame_error(target) from error
            return self._note_damage(target)
        if not any(map(is_made_here, parts)):
            raise _foreign_frame_error(target)
        found = (p.attributes.get(FINGERPRINT) for p in parts)
        difference = wanted.difference(next((str(f) for f in found if f), None))
        if difference is None:
            return parts if is_whole(target) else self._note_damage(target)
        if self.options.keep:
            raise OutputError(
                f"was finished before {difference}, and is kept",
                where=target,
                remedy="leave --keep out to render it again",
            )
        sentence = f"{plate.name}: finished before {difference}, and rendered again"
        self.lens.notes.add(FrameNote(sentence, f"rendered again {difference}"))
        return ()

    def _note_damage(self, target: Path) -> tuple[ExrPart, ...]:
        """None of its parts, which is noted."""
        self.lens.notes.add(f"{target} was damaged and is rendered again")
        return ()


def _begins_as_ours(target: Path) -> bool:
    """Whether a file that cannot be read begins as the frames written here do, or ends
    before there could be a picture in it."""
    with target.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    cut_short = head.startswith(MAGIC) and len(head) < _LEAST_BYTES
    return not head or cut_short or FINGERPRINT.encode() in head


def _foreign_frame_error(target: Path) -> OutputError:
    return OutputError(
        "is there already and is no frame that lensfit rendered",
        where=target,
        remedy="choose another --out, or replace it with --overwrite",
    )


def with_fingerprint(image: ExrImage, made_of: Fingerprint) -> ExrImage:
    """The frame, whose rendered parts say what they are made of."""
    return ExrImage(
        tuple(
            replace(p, attributes={**p.attributes, FINGERPRINT: made_of.text})
            if is_made_here(p)
            else p
            for p in image.parts
        )
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
