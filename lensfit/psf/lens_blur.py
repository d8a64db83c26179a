"""The blur of a lens at one state, ready for any image point and object distance.

The aberrations are known for objects at one distance, the reference. An object at
another one changes three things, all by first-order optics and the chief-ray map: its
sharp image moves (`optics.depth`), the pupil looks larger or smaller from there
(`optics.paraxial.rim_sine`; rims and stop alike), and diffraction follows the pupil.

Image points are sensor millimetres, origin at the sensor centre, x right, y down, where
the green chief ray of the object lands; object distances count from the sensor plane.
Every function takes one point; callers map it over many.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lensfit.optics.aberration import (
    Aberration,
    LocalWavefront,
    local_wavefront,
    no_aberration,
)
from lensfit.optics.depth import (
    ObjectShift,
    cylinder_mm,
    log_squeeze,
    object_shift,
    sections_of,
)
from lensfit.optics.distortion import (
    Distortion,
    jacobian_at,
    undistorted_from_distorted,
)
from lensfit.optics.lateral import (
    ChannelShift,
    LateralColour,
    channel_from_green,
)
from lensfit.optics.paraxial import (
    FirstOrder,
    first_order_of,
    magnification,
    rim_sine,
)
from lensfit.optics.pupil import Pupil, clear_pupil, opening_area
from lensfit.optics.spectrum import Bands, bands, chromatic_coordinate, lateral_at
from lensfit.optics.stop_places import Transmission

_MM_PER_NM = 1e-6
_EXACT_AT = (0.7, 1.05)


class LensBlur(eqx.Module):
    """What makes the blur of a lens at one focal length, f-number and focus.

    Attributes
    ----------
    aberration : For objects at the reference distance.
    pupil : Stop and rims, seen from the image of such an object.
    first_order : Cardinal data.
    reference_distance_mm : May be infinite.
    defocus_mm : How far the sensor lies behind the sharp image of an object at the
        reference distance.
    stop_radius : Of the stop as set, in radii of the reference stop.
    bands : Wavelengths of red, green and blue.
    transmission : Of the stop; None where it is clear.
    known : The opening through which the aberrations were measured, where `pupil` may
        let other rays through: these are aberrated as the nearest that was measured.
    oval : By how much the blur is drawn out along x and y; None for nothing.
    measured_lateral : Lateral colour by which the wavelengths of one channel part,
        where the lens' own was turned; None for the lens' own.
    beyond_mm : How much farther than the y section the x section of an anamorphic lens
        is out of focus, beyond what makes both sharp at the focus distance
        (`optics.depth`); None for a lens that has but one section.
    is_ideal : Whether nobody measured it, and nothing but its stop was turned.
    """

    aberration: Aberration
    pupil: Pupil
    first_order: FirstOrder
    reference_distance_mm: Float[Array, ""]
    defocus_mm: Float[Array, ""]
    stop_radius: Float[Array, ""]
    bands: Bands
    transmission: Transmission | None = None
    known: Pupil | None = None
    oval: Float[Array, "2"] | None = None
    measured_lateral: LateralColour = None
    beyond_mm: Float[Array, ""] | None = None
    is_ideal: bool = eqx.field(static=True, default=False)

    @property
    def nearest_mm(self) -> float:
        """The front focal point; objects nearer than it have no real image."""
        first = self.first_order
        pupil_mm = first.focal_length_mm / first.pupil_magnification
        return float(first.entrance_pupil_offset_mm + pupil_mm)


class Pencil(NamedTuple):
    """The light of one object point through one channel, before its rays are chosen.

    Attributes
    ----------
    h : Field point in field radii.
    channel : 0, 1 or 2 for red, green or blue.
    local : Aberration function of each wavelength.
    lateral_mm : Where its chief ray lands, from where green's does.
    grown : Direction cosines at the pupil over those for the reference distance.
    diffraction_mm2 : Variance of the Gaussian of each wavelength, but for the constant
        of `spot`.
    """

    h: Float[Array, "2"]
    channel: Int[Array, ""]
    local: LocalWavefront
    lateral_mm: Float[Array, "wavelengths 2"]
    grown: Float[Array, ""]
    diffraction_mm2: Float[Array, " wavelengths"]


def perfect_blur(
    distortion: Distortion,
    entrance_pupil_offset_mm: Float[Array, ""],
    f_number: float,
    focus_distance_mm: float,
) -> LensBlur:
    """A lens without aberrations, its pupils flat and of one size.

    A flat pupil is foreshortened off axis, to cos^3 of the field angle along the field
    and to cos across it, so that the blur of a point is one disc all over the frame.
    """
    one = jnp.ones(())
    focus = jnp.asarray(focus_distance_mm, float)
    c = distortion.principal_distance_mm
    first_order = first_order_of(c, one, entrance_pupil_offset_mm, focus)
    sine = rim_sine(first_order, jnp.asarray(f_number, float), focus)
    return LensBlur(
        aberration=no_aberration(
            (),
            field_radius_mm=float(distortion.reference_radius_mm),
            f_number=float(0.5 / sine),
            exit_pupil_distance_mm=float(c),
        ),
        pupil=_flat_pupil(distortion.reference_radius_mm / c),
        first_order=first_order,
        reference_distance_mm=focus,
        defocus_mm=jnp.zeros(()),
        stop_radius=one,
        bands=bands(),
        is_ideal=True,
    )


def _flat_pupil(edge_slope: Array) -> Pupil:
    """The clear pupil, foreshortened; exact at `_EXACT_AT` of the field radius.

    Parameters
    ----------
    edge_slope : Tangent of the field angle at the field radius.
    """
    # log cos = a s + b s^2 in s = |h|^2, through two points
    s1, s2 = (r * r for r in _EXACT_AT)
    y1, y2 = (-jnp.log1p(s * edge_slope**2) / 2 for s in (s1, s2))
    b = (y2 / s2 - y1 / s1) / (s2 - s1)
    across = jnp.stack([y1 / s1 - b * s1, b])
    clear = clear_pupil()
    return eqx.tree_at(lambda p: p.stretch, clear, jnp.stack([3 * across, across]))


def pencil(
    image_point_mm: Float[Array, "2"],
    object_distance_mm: Float[Array, ""],
    channel: Int[Array, ""],
    blur: LensBlur,
    distortion: Distortion,
    lateral_colour: LateralColour,
) -> Pencil:
    """Everything about one object point that does not depend on the ray.

    Parameters
    ----------
    object_distance_mm : May be infinite.
    channel : 0, 1 or 2 for red, green or blue.
    lateral_colour : Displacement of red and of blue, or None when there is none.
    """
    undistorted = undistorted_from_distorted(image_point_mm, distortion)
    c = distortion.principal_distance_mm
    reference, first_order = blur.reference_distance_mm, blur.first_order
    # The map was measured with the sensor at focus, c away; the depth of an object
    # counts from the reference's image.
    per_slope = jacobian_at(undistorted, distortion) * _image_distance(blur, reference)
    depth = object_shift(
        (undistorted - distortion.principal_point_mm) / c,
        per_slope,
        first_order,
        reference,
        object_distance_mm,
    )
    field_mm = image_point_mm - distortion.principal_point_mm
    wavelengths_nm = blur.bands.wavelengths_nm[channel]
    local = jax.vmap(local_wavefront, (None, 0, None, None, None))(
        field_mm,
        chromatic_coordinate(wavelengths_nm),
        blur.aberration,
        depth,
        _cylinder_mm(blur, depth, object_distance_mm, distortion),
    )
    h = field_mm / blur.aberration.field_radius_mm
    grown = _bellows(blur, reference) / _bellows(blur, object_distance_mm)
    area = opening_area(h, blur.stop_radius, blur.pupil)
    sine = blur.aberration.reference_sine * grown * jnp.sqrt(area / jnp.pi)
    lateral = _lateral_mm(image_point_mm, channel, blur, distortion, lateral_colour)
    per_airy = wavelengths_nm * _MM_PER_NM / (2 * sine)
    return Pencil(h, channel, local, lateral, grown, per_airy**2)


def _cylinder_mm(
    blur: LensBlur, depth: ObjectShift, distance_mm: Array, distortion: Distortion
) -> Array | None:
    if blur.beyond_mm is None:
        return None
    # Rays of one pupil point have the smaller p the longer c is; `depth` holds half
    # of that.
    here, there = (
        _image_distance(blur, z) for z in (distance_mm, blur.reference_distance_mm)
    )
    made_for_mm = there * jnp.sqrt(there / here)
    sections = sections_of(depth, made_for_mm, log_squeeze(distortion))
    return cylinder_mm(blur.defocus_mm, blur.beyond_mm, sections)


def _image_distance(blur: LensBlur, distance_mm: Array) -> Array:
    """Principal distance of a sensor that is sharp at this distance."""
    first = blur.first_order
    pupil_mm = first.focal_length_mm / first.pupil_magnification
    to_pupil = distance_mm - first.entrance_pupil_offset_mm
    return first.focal_length_mm / (1 - pupil_mm / to_pupil)


def _bellows(blur: LensBlur, distance_mm: Array) -> Array:
    first = blur.first_order
    return 1 - magnification(first, distance_mm) / first.pupil_magnification


def _lateral_mm(
    point: Array,
    channel: Array,
    blur: LensBlur,
    distortion: Distortion,
    lateral_colour: LateralColour,
) -> Array:
    """Displacement of the wavelengths of a channel, (wavelengths, 2).

    They part as was measured, about the channel's own displacement, turned or not.
    """
    wavelengths_nm = blur.bands.wavelengths_nm
    if lateral_colour is None:
        return jnp.zeros((wavelengths_nm.shape[1], 2))
    own = _channel_displacements(point, lateral_colour, distortion)[channel]
    measured = blur.measured_lateral or lateral_colour
    red, _, blue = _channel_displacements(point, measured, distortion)
    chromatic = chromatic_coordinate(wavelengths_nm)
    parted = lateral_at(chromatic[channel], red, blue, jnp.mean(chromatic, 1))
    return parted + (own - jnp.mean(parted, 0))[None]


def _channel_displacements(
    point: Array, lateral: tuple[ChannelShift, ChannelShift], distortion: Distortion
) -> Array:
    """Displacement of red, green and blue from where green lands, (3, 2)."""
    centre, radius = distortion.principal_point_mm, distortion.reference_radius_mm
    red, blue = (
        channel_from_green(point, shift, centre, radius) - point for shift in lateral
    )
    return jnp.stack([red, jnp.zeros(2), blue])
