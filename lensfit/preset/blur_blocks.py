"""The blur of one lens state, as it stands in a preset file.

What makes the shape of an out-of-focus or aberrated point: the aberration function
(`lensfit.optics.aberration`), the opening that light comes through
(`lensfit.optics.pupil`), and the first-order data from which defocus follows for any
object distance (`lensfit.optics.paraxial`). One block serves all f-numbers and all
object distances; `lensfit.preset.blur_of_block` turns it into the optics and back.

Lengths are millimetres on the sensor unless the name says otherwise, angles radians
from x (right) towards y (down), distances to the scene count from the sensor plane. A
field point h counts in `field_radius_mm` from the principal point.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from lensfit.preset.blocks import Pair, PositiveFloat

Count = Annotated[int, Meta(ge=0)]
Bands = tuple[PositiveFloat, PositiveFloat, PositiveFloat]


class AberrationTerm(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True
):
    """One term of the aberration function (`lensfit.optics.terms`).

    Attributes
    ----------
    degree, order : Of the pupil mode; the order is azimuthal.
    field_degree, field_order : Of the field function; the order is signed.
    part : Real or imaginary part.
    um : Rms spot radius that the term adds over the reference aperture at the edge of
        the field, micrometres.
    um_by_colour : Linear and quadratic change with the chromatic coordinate of
        `lensfit.optics.spectrum`; empty for none.
    """

    degree: Annotated[int, Meta(ge=2)]
    order: Count
    field_degree: Count
    field_order: int
    part: Literal["re", "im"]
    um: float
    um_by_colour: tuple[float, ...] = ()


class Rim(Struct, frozen=True, forbid_unknown_fields=True):
    """A disc that clips the pupil away from the axis.

    Attributes
    ----------
    shift : a0, a1 of its centre h (a0 + a1 |h|^2), in radii of the reference stop.
    radius : r0, r1 of its radius r0 + r1 |h|^2.
    """

    shift: Pair
    radius: Pair


class Pupil(Struct, frozen=True, forbid_unknown_fields=True):
    """The opening of the lens (`lensfit.optics.pupil`).

    Attributes
    ----------
    rims : Discs that clip the stop.
    stop_shift : b0, b1 of the stop's centre h t^2 (b0 + b1 |h|^2), t its radius.
    stretch_along, stretch_across : Coefficients of |h|^2, |h|^4 in the logarithm of the
        pupil's stretch, along the field direction and across it.
    squeeze : Width of the pupil over its height, in direction cosines.
    blades : Number of blades; 0 for a stop that is round at every f-number.
    blade_rotation_rad : Azimuth of one corner.
    blade_curvature : 0 for straight blades, 1 for a round opening.
    """

    rims: tuple[Rim, ...] = ()
    stop_shift: Pair = (0.0, 0.0)
    stretch_along: Pair = (0.0, 0.0)
    stretch_across: Pair = (0.0, 0.0)
    squeeze: PositiveFloat = 1.0
    blades: Count = 0
    blade_rotation_rad: float = 0.0
    blade_curvature: float = 0.0


class Stop(Struct, frozen=True, forbid_unknown_fields=True):
    """What an f-number on the barrel really opens.

    Attributes
    ----------
    radius_ratio : Radius of the stop over the one that the f-number says.
    """

    f_number: PositiveFloat
    radius_ratio: PositiveFloat = 1.0


class BlurUncertainty(Struct, frozen=True, forbid_unknown_fields=True):
    """How well the numbers of a blur block are known, and how they correlate.

    Their covariance is the sum of the outer products of the moves.

    Attributes
    ----------
    numbers : Names of the numbers that move (`lensfit.preset.blur_numbers`).
    moves : Moves of all of them, each by one standard deviation and independent of the
        others; the one that changes the photographs most comes first.
    """

    numbers: tuple[str, ...]
    moves: tuple[tuple[float, ...], ...]


class Blur(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Aberrations, pupil and first-order optics of one lens state.

    Attributes
    ----------
    aberrations : Terms; each stands once.
    field_radius_mm : Unit of the field point.
    reference_sine : Direction cosine at the rim of the reference aperture, on the axis;
        unit of the pupil point.
    exit_pupil_distance_mm : From the exit pupil to the sensor.
    chief_bend : Relative change of the chief ray's direction cosine at the edge.
    pupil_magnification : Exit pupil over entrance pupil.
    reference_distance_mm : Object distance that the aberrations hold for; "inf" in the
        file when infinite.
    focus_offset_mm : How far the sensor lies behind the sharp image of an object at the
        reference distance, beyond what first-order optics says from the entry's
        focus_distance_mm; where that is unknown, beyond an object in focus at the
        reference distance.
    pupil : The opening.
    stops : One for each f-number that was measured, widest first; may be empty.
    band_centres_nm, band_widths_nm : Of red, green and blue; widths are standard
        deviations.
    round_f_number : At this f-number (within 2 %) and wider ones the opening is round;
        the blades show when it is stopped down further.
    assumed : Names of the values above that were stated or assumed, not measured.
    uncertainty : Of all these numbers; None if unknown.
    beyond_offset_mm : Of an anamorphic lens: how much farther its section along x is
        out of focus than its section along y, beyond what makes both sharp at one
        distance (`lensfit.optics.sections`); `focus_offset_mm` is then that of y. Null
        where the two are one.
    """

    aberrations: tuple[AberrationTerm, ...]
    field_radius_mm: PositiveFloat
    reference_sine: Annotated[float, Meta(gt=0, lt=1)]
    exit_pupil_distance_mm: PositiveFloat
    chief_bend: float = 0.0
    pupil_magnification: PositiveFloat
    reference_distance_mm: PositiveFloat
    focus_offset_mm: float
    pupil: Pupil
    stops: tuple[Stop, ...]
    band_centres_nm: Bands
    band_widths_nm: Bands
    round_f_number: PositiveFloat
    assumed: tuple[str, ...] = ()
    uncertainty: BlurUncertainty | None = None
    beyond_offset_mm: float | None = None
