"""A plate with its depth: distances, objects, and the objects separated from it."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from lensfit.io.exr import ExrImage, ExrPart
from lensfit.plate.camera.plate_state import PlateState
from lensfit.plate.cut_out import CutOut
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.plate_depth import plate_depth
from lensfit.plate.plate_mattes import matte_cut_out, named_cut_out, plate_mattes
from lensfit.preset.scaled_look import UNSCALED
from lensfit.rendering.layer_stack import Mattes


class PlateInDepth(NamedTuple):
    """What is known over the data window of a part with colours.

    Attributes
    ----------
    depth_mm, mattes : Of the plate; without what is cut out of it, if anything is.
    cut_out : The objects of the edge mask.
    """

    depth_mm: Float32[np.ndarray, "height width"]
    mattes: Mattes | None
    cut_out: CutOut | None = None

    @property
    def seen_depth_mm(self) -> Float32[np.ndarray, "height width"]:
        """Of the nearest thing in each pixel."""
        return self.depth_mm if self.cut_out is None else self.cut_out.seen_depth_mm


def plate_in_depth(
    lens: PlateLens, part: ExrPart, state: PlateState, image: ExrImage, path: Path
) -> PlateInDepth | None:
    """The depth of a part with colours; None where depth of field is not wanted.

    Raises
    ------
    ImageError : The plate has no depth, its f-number or focus distance is not known, or
        the edge mask names an object or a channel that the plate does not have.
    """
    if not lens.options.switches.defocus:
        return None
    geometry = lens.geometry(state, part.display_window)
    focal_length_mm = lens.cg_focal_length_mm(state)
    found = plate_depth(image, part, lens.options.depth, geometry, focal_length_mm)
    lens.notes.add(*found.notes)
    state.require_blur()
    depth, unit_mm = found.depth_mm, found.unit_mm
    if state.scaled != UNSCALED:
        depth = depth / np.float32(state.scaled.distances)
        unit_mm /= state.scaled.distances
    lens.note_focus(depth, unit_mm, state, part.display_window, path)
    depth = lens.within_reach(depth, state)
    window, options = part.data_window, lens.options
    if options.edge_matte is not None:
        cut = matte_cut_out(depth, image, path, part, options.edge_matte)
        # The plate's Cryptomatte may hold its objects too, and nobody takes them out.
        return PlateInDepth(cut.rest_depth_mm, None, cut)
    if not options.edge_mask:
        return PlateInDepth(depth, plate_mattes(image, path, window))
    cut = named_cut_out(depth, image, path, window, options.edge_mask)
    return PlateInDepth(cut.rest_depth_mm, cut.rest_mattes, cut)
