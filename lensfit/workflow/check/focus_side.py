"""The side of focus of a view, from its statements and from the change of image size.

Turning the focus ring changes the size of the image (breathing), steadily with the
vergence 1/D of the focus distance D. Of views of one target from one place, those
focused nearer than it are therefore all imaged larger than the one in focus, or all
smaller, and those focused beyond it the opposite; the lens' design decides which. A
view whose image changed as those of the *other* side contradicts its statement.

Only views of the same standing target can be compared: the matrix of pixels per pitch
at the middle of the frame must agree but for its size. Blur and image size are in
pixels, so photographs of another size are not compared.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from lensfit.units import dioptres_from_mm
from lensfit.workflow.check.check_records import FocusSide

_SAME_POSE = 2e-3
"""Largest difference of the two matrices once they are of one size."""
_LEAST_BREATHING = 2e-4
_ON_TARGET_DIOPTRES = 0.01
"""Focus and target nearer to each other than this are meant to be the same."""


@final
@dataclass(frozen=True, eq=False)
class View:
    """What is compared of a photograph.

    Attributes
    ----------
    name : As messages name it.
    target : Of the shoot file, or the chart's description.
    focal_length_mm, focus_distance_mm, target_distance_mm : As stated; None if not.
    image_size_px : Width and height of the photograph.
    cell_px : Pixels per pitch at the middle of the frame: columns along i and j.
    blur_px : Diameter of the blur at the centre of the frame; None if not measured.
    """

    name: str
    target: str
    focal_length_mm: float | None
    f_number: float | None
    focus_distance_mm: float | None
    target_distance_mm: float | None
    image_size_px: tuple[int, int]
    cell_px: Float[np.ndarray, "2 2"]
    blur_px: float | None

    @property
    def size_px(self) -> float:
        """Side of a cell of the lattice, as large as a square of its area."""
        return math.sqrt(abs(float(np.linalg.det(self.cell_px))))

    @property
    def nearer_by_dioptres(self) -> float | None:
        """How much nearer than the target the lens is focused; None if not stated."""
        if self.focus_distance_mm is None or self.target_distance_mm is None:
            return None
        focus, target = self.focus_distance_mm, self.target_distance_mm
        return dioptres_from_mm(focus) - dioptres_from_mm(target)


def focus_side(view: View, earlier: Sequence[View]) -> FocusSide:
    """The side of a view, checked against those before it."""
    stated = _stated_side(view)
    like = [one for one in earlier if _comparable(view, one)]
    known = [one for one in [*like, view] if one.blur_px is not None]
    if len(known) < 2 or view.blur_px is None:
        return FocusSide(stated)
    sharpest = min(known, key=lambda one: one.blur_px or math.inf)
    if sharpest is view:
        return FocusSide(stated, 0.0, view.name)
    growth = math.log(view.size_px / sharpest.size_px)
    agrees, against = _agreement(view, growth, sharpest, like)
    return FocusSide(stated, 100 * growth, sharpest.name, agrees, against)


def blurrier_in_focus(view: View, earlier: Sequence[View]) -> View | None:
    """A view stated out of focus that is sharper than this one, stated in focus."""
    own = view.nearer_by_dioptres
    if own is None or abs(own) > _ON_TARGET_DIOPTRES or view.blur_px is None:
        return None
    for one in earlier:
        theirs = one.nearer_by_dioptres
        if theirs is None or abs(theirs) <= _ON_TARGET_DIOPTRES or not one.blur_px:
            continue
        alike = _comparable(view, one) and one.f_number == view.f_number
        if alike and one.blur_px < 0.8 * view.blur_px:
            return one
    return None


def _agreement(
    view: View, growth: float, sharpest: View, like: Sequence[View]
) -> tuple[bool | None, str | None]:
    """Whether the image grew as on other views of the stated side."""
    own = view.nearer_by_dioptres
    if own is None or abs(own) <= _ON_TARGET_DIOPTRES or abs(growth) < _LEAST_BREATHING:
        return None, None
    for one in like:
        theirs = one.nearer_by_dioptres
        if one is sharpest or theirs is None or abs(theirs) <= _ON_TARGET_DIOPTRES:
            continue
        grew = math.log(one.size_px / sharpest.size_px)
        if abs(grew) < _LEAST_BREATHING:
            continue
        if (own * theirs > 0) == (growth * grew > 0):
            return True, None
        return False, one.name
    return None, None


def _comparable(view: View, other: View) -> bool:
    """Same target, focal length and pixels, same pose but for the size of the image."""
    alike = ("target", "focal_length_mm", "image_size_px")
    if any(getattr(view, key) != getattr(other, key) for key in alike):
        return False
    mine, theirs = view.cell_px / view.size_px, other.cell_px / other.size_px
    return bool(np.abs(mine - theirs).max() < _SAME_POSE)


def _stated_side(view: View) -> str | None:
    nearer = view.nearer_by_dioptres
    if nearer is None:
        return None
    if abs(nearer) <= _ON_TARGET_DIOPTRES:
        return "on the target"
    return "nearer than the target" if nearer > 0 else "beyond the target"
