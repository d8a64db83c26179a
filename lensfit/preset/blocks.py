"""The numbers of one lens state, as they stand in a preset file.

Lengths are millimetres on the sensor, angles radians, the origin is the sensor centre
with x right and y down. A radius or coefficient without a unit counts in
`reference_radius_mm`, from the principal point. Each block mirrors a module of
`lensfit.optics`, where its formula stands; `lensfit.preset.lens_of_entry` joins them.

The block of the blur holds what makes the shape of an out-of-focus or aberrated point:
the aberration function (`lensfit.optics.aberration`), the opening that light comes
through (`lensfit.optics.pupil`), and the first-order data from which defocus follows
for any object distance (`lensfit.optics.paraxial`). One block serves all f-numbers and
all object distances; `lensfit.preset.blur_of_block` turns it into the optics and back.

Angles there count from x (right) towards y (down), distances to the scene from the
sensor plane. A field point h counts in `field_radius_mm` from the principal point.
"""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from msgspec import Meta, Struct


class Covariance(Struct, frozen=True, forbid_unknown_fields=True):
    """How well the fitted parameters are known, and how they correlate.

    Attributes
    ----------
    parameters : Names, in the order of the rows.
    standard_deviation : One for each parameter, in its own unit.
    correlation : Lower triangle by rows; row i ends with its diagonal 1.
    """

    parameters: tuple[str, ...]
    standard_deviation: tuple[float, ...]
    correlation: tuple[tuple[float, ...], ...]

    @classmethod
    def from_matrix(
        cls,
        parameters: tuple[str, ...],
        matrix: Float[np.ndarray, "parameters parameters"],
    ) -> "Covariance":
        """From a covariance matrix; what has no variance correlates with nothing."""
        deviation = np.sqrt(np.clip(np.diag(matrix), 0.0, None))
        scale = np.where(deviation > 0, deviation, 1.0)
        correlation = matrix / np.outer(scale, scale)
        np.fill_diagonal(correlation, 1.0)
        return cls(
            tuple(parameters),
            tuple(deviation.tolist()),
            tuple(tuple(row[: i + 1].tolist()) for i, row in enumerate(correlation)),
        )

    def ordered_as(self, names: Sequence[str]) -> Float[np.ndarray, "names names"]:
        """The covariance matrix of these; zero for those that are not among them."""
        rows = [k for k, name in enumerate(self.parameters) if name in names]
        places = [names.index(self.parameters[k]) for k in rows]
        found = np.zeros((len(names),) * 2)
        found[np.ix_(places, places)] = self.matrix()[np.ix_(rows, rows)]
        return found

    def matrix(self) -> Float[np.ndarray, "parameters parameters"]:
        """The symmetric covariance matrix."""
        deviation = np.asarray(self.standard_deviation)
        return self.correlations() * np.outer(deviation, deviation)

    def correlations(self) -> Float[np.ndarray, "parameters parameters"]:
        """The whole symmetric matrix of correlations."""
        found = np.zeros((len(self.parameters),) * 2)
        for i, row in enumerate(self.correlation):
            found[i, : i + 1] = found[: i + 1, i] = row
        return found


def lateral_names(radial_terms: int) -> list[str]:
    """Names of the numbers of a channel's displacement, in the order of
    `lensfit.optics.lateral.displacement_basis`."""
    sizes = {"shift_mm": 2, "strain": 2, "decentering": 2, "radial": radial_terms}
    return member_names(sizes)


def fall_off_names(channel: str, terms: int) -> list[str]:
    """Names of the control values of a channel."""
    return member_names({channel: terms})


def member_names(sizes: dict[str, int]) -> list[str]:
    """Names of the members of lists: "radial[0]", "radial[1]", ..."""
    return [f"{name}[{k}]" for name, size in sizes.items() for k in range(size)]


PositiveFloat = Annotated[float, Meta(gt=0)]
Pixels = Annotated[int, Meta(gt=0)]
Pair = tuple[float, float]


class PupilShift(Struct, frozen=True, forbid_unknown_fields=True):
    """How the entrance pupil moves with field angle (`lensfit.optics.projection`).

    Attributes
    ----------
    shift_mm : Towards the scene, per squared sine of the field angle.
    chart_distance_mm : From the sensor plane; for objects there the map of the chief
        rays holds as it stands.
    standard_deviation_mm : Of the shift.
    """

    shift_mm: float
    chart_distance_mm: PositiveFloat
    standard_deviation_mm: float


class Projection(Struct, frozen=True, forbid_unknown_fields=True):
    """The pinhole camera behind the lens.

    Attributes
    ----------
    principal_distance_mm : Image distance of the pinhole; for an anamorphic lens the
        geometric mean of both axes'.
    principal_point_mm : Where the optical axis meets the sensor.
    entrance_pupil_offset_mm : Position of the entrance pupil in front of the sensor
        plane, positive towards the scene.
    assumed : Names of the values above that were stated or assumed, not measured.
    pupil_shift : How the pupil moves with field angle; None if unknown.
    """

    principal_distance_mm: PositiveFloat
    principal_point_mm: Pair
    entrance_pupil_offset_mm: float
    assumed: tuple[str, ...] = ()
    pupil_shift: PupilShift | None = None


class FreeField(Struct, frozen=True, forbid_unknown_fields=True):
    """Smooth distortion that no named term describes (`lensfit.optics.field`).

    Attributes
    ----------
    degree : Total degree of the Chebyshev products, from 3.
    x, y : Coefficients, lowest total degree first, in reference radii.
    """

    degree: Annotated[int, Meta(ge=3)]
    x: tuple[float, ...]
    y: tuple[float, ...]


class Distortion(Struct, frozen=True, forbid_unknown_fields=True):
    """The chief-ray map (`lensfit.optics.distortion`).

    Attributes
    ----------
    base : Ideal projection that distortion is measured from.
    reference_radius_mm : Unit of every radius and coefficient below.
    valid_radius : 1.05 times the largest radius of a detection of any state, from the
        sensor centre on the photograph; beyond it the radial polynomial levels off.
    valid_box : x0, y0, x1, y1 of all detections, 5 % larger; other terms are constant
        beyond it.
    radial_log_slope : a1, a2, ... of ln(dr'/dr) = a1 r^2 + a2 r^4 + ...
    decentering : Brown's two coefficients, then the same two times r^2.
    thin_prism : r^2 along x and y, then r^4.
    anamorphic : Terms of odd degree with both mirror symmetries.
    squeeze : Ratio by which the image is narrower along the squeezed axis.
    squeeze_axis_rad : Azimuth of the squeezed axis, from +x towards +y.
    field : The free field, or None.
    """

    base: Literal["rectilinear", "stereographic", "equidistant"]
    reference_radius_mm: PositiveFloat
    valid_radius: PositiveFloat
    valid_box: tuple[float, float, float, float]
    radial_log_slope: tuple[float, ...] = ()
    decentering: tuple[float, ...] = ()
    thin_prism: tuple[float, ...] = ()
    anamorphic: tuple[float, ...] = ()
    squeeze: PositiveFloat = 1.0
    squeeze_axis_rad: float = 0.0
    field: FreeField | None = None


class ChannelShift(Struct, frozen=True, forbid_unknown_fields=True):
    """Where one channel lands, relative to green.

    Attributes
    ----------
    radial : c0, c1, ... of the relative change of radius, c0 + c1 r^2 + ...
    shift_mm : The same displacement everywhere.
    valid_radius : Largest photographed radius; beyond it the displacement stays.
    strain : Magnification that differs between azimuths: s cos 2a, s sin 2a; or none.
    decentering : Brown's two coefficients; or none.
    """

    radial: tuple[float, ...]
    shift_mm: Pair
    valid_radius: PositiveFloat
    strain: tuple[float, ...] = ()
    decentering: tuple[float, ...] = ()


class LateralCovariance(Struct, frozen=True, forbid_unknown_fields=True):
    """How well the displacement of red and of blue is known; parameters are named as
    the numbers of the channel: "shift_mm[0]", "radial[1]"."""

    r: Covariance
    b: Covariance


class LateralColour(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True
):
    """Displacement of red and blue against green.

    Attributes
    ----------
    r, b : Of each channel.
    covariance : Of their numbers, each in its own unit; None if unknown.
    """

    r: ChannelShift
    b: ChannelShift
    covariance: LateralCovariance | None = None


class FallOffCovariance(Struct, frozen=True, forbid_unknown_fields=True):
    """How well the control values of each channel are known; parameters are named as
    these: "r[0]", "r[1]"."""

    r: Covariance
    g: Covariance
    b: Covariance


class FallOff(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Relative illumination at one f-number, 1 on the axis (`lensfit.optics.falloff`).

    Attributes
    ----------
    f_number : As on the barrel; None if not stated.
    valid_radius_mm : Where the control values end: the farthest corner of the
        photographs, or somewhat beyond the outermost detection.
    r, g, b : Control values b_1 ... b_n of -ln(illumination) as a Bernstein polynomial
        of the squared radius; they never fall.
    predicted : Whether it follows from the pupil's shape, measured at other f-numbers.
    covariance : Of the control values; None if unknown.
    """

    f_number: PositiveFloat | None
    valid_radius_mm: PositiveFloat
    r: tuple[float, ...]
    g: tuple[float, ...]
    b: tuple[float, ...]
    predicted: bool = False
    covariance: FallOffCovariance | None = None


class Camera(Struct, frozen=True, forbid_unknown_fields=True):
    """The sensor area, and the photographs' pixels across it."""

    model: str | None
    sensor_width_mm: PositiveFloat
    sensor_height_mm: PositiveFloat
    image_width_px: Pixels
    image_height_px: Pixels


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
    numbers : Names of the numbers that move (`lensfit.preset.blur_of_block`).
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
        distance (`lensfit.optics.depth`); `focus_offset_mm` is then that of y. Null
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
