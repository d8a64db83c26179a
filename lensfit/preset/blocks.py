"""The numbers of one lens state, as they stand in a preset file.

Lengths are millimetres on the sensor, angles radians, the origin is the sensor centre
with x right and y down. A radius or coefficient without a unit counts in
`reference_radius_mm`, from the principal point. Each block mirrors a module of
`lensfit.optics`, where its formula stands; `lensfit.preset.lens_of_entry` joins them.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from lensfit.preset.covariance import Covariance

PositiveFloat = Annotated[float, Meta(gt=0)]
Pixels = Annotated[int, Meta(gt=0)]
Pair = tuple[float, float]


class PupilShift(Struct, frozen=True, forbid_unknown_fields=True):
    """How the entrance pupil moves with field angle (`lensfit.optics.pupil_shift`).

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
