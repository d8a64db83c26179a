"""The opening that light comes through, seen from one field point: stop, blades, rims.

In stop coordinates s the stop of the widest aperture is the unit disc, another f-number
scales it, and each rim of the barrel is a disc that shifts as the field point
moves away from the axis,

    centre = h (a0 + a1 |h|^2),     radius = r0 + r1 |h|^2,

with h the field point in field radii. (The stop's centre may shift a little too: the
coma of the pupil, whose chief ray is not in its middle.) Blades are N circular arcs
(curvature 0 straight, 1 the circle), their opening of the same area as the round
stop's. The direction cosines of the rays, in units of those at the rim of the reference
aperture on the axis, are

    u = S(h) s,

with S a stretch along and across the field direction: the foreshortened, aberrated exit
pupil. A pencil's light is nearly uniform in u (`aberration.light_density` has the
rest), so that the area of the opening over that on the axis is the relative
illumination, natural fall-off included.

All boundaries are convex, so the opening is seen from a point inside it as one radius
for each azimuth: the smallest distance to any boundary, taken as a p-norm. That makes
every quantity infinitely differentiable, rims that just touch included; the price is a
relative error of the radius of at most ln(n)/p where n boundaries coincide.

Every function takes one field point; callers map it over many with `jax.vmap`.

Reference: the cat's eye as intersecting discs: K. Kolb, D. Mitchell and P. Hanrahan,
SIGGRAPH 1995, and W. J. Smith, Modern Optical Engineering, on vignetting.
"""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

SHARPNESS = 128.0
"""The p of the norm that stands for the smallest of several radii."""
AREA_AZIMUTHS = 128
MOST_BLADES = 16
"""More are round. One program serves any number up to it."""
_FAR = 1e-6


class Pupil(eqx.Module):
    """Stop and rims of one lens, the same for every f-number.

    Attributes
    ----------
    rim_shift : a0, a1 of each rim.
    rim_radius : r0, r1 of each rim, in radii of the reference stop.
    stop_shift : b0, b1 of the stop's centre h t^2 (b0 + b1 |h|^2), t its radius.
    stretch : Coefficients of |h|^2, |h|^4 in the logarithm of S, first along the field
        direction, then across it.
    squeeze : Logarithm of the width over the height of the pupil in u (anamorphic).
    blade_rotation_rad : Azimuth of one corner, from x towards y.
    blade_curvature : 0 for straight blades, 1 for a round opening.
    blades : Number of blades, up to `MOST_BLADES`; 0 for a round stop.
    """

    rim_shift: Float[Array, "rims 2"]
    rim_radius: Float[Array, "rims 2"]
    stop_shift: Float[Array, "2"]
    stretch: Float[Array, "2 2"]
    squeeze: Float[Array, ""]
    blade_rotation_rad: Float[Array, ""]
    blade_curvature: Float[Array, ""]
    blades: Float[Array, ""] = eqx.field(
        converter=lambda n: jnp.asarray(n, float) if isinstance(n, int) else n,
        default=0,
    )


def clear_pupil(rims: int = 0, blades: int = 0) -> Pupil:
    """A round stop and rims too wide to clip."""
    return Pupil(
        rim_shift=jnp.zeros((rims, 2)),
        rim_radius=jnp.tile(jnp.array([3.0, 0.0]), (rims, 1)),
        stop_shift=jnp.zeros(2),
        stretch=jnp.zeros((2, 2)),
        squeeze=jnp.zeros(()),
        blade_rotation_rad=jnp.zeros(()),
        blade_curvature=jnp.zeros(()),
        blades=blades,
    )


def pupil_rays(
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
    azimuth_rad: Float[Array, " rays"],
    reach: Float[Array, " rays"],
    sharpness: float = SHARPNESS,
) -> tuple[Float[Array, "rays 2"], Float[Array, " rays"]]:
    """Rays at chosen places of the opening, as polar coordinates of the unit disc.

    Parameters
    ----------
    reach : 0 at a point inside the opening, 1 at its edge.

    Returns
    -------
    u, and the area of the opening per area of the unit disc, times pi: its mean over
    an evenly filled disc is `opening_area`.
    """
    centre, outward, radius = edge_from_inside(
        azimuth_rad, h, stop_radius, pupil, sharpness
    )
    s = centre[None] + (reach * radius)[:, None] * outward
    stretch = jnp.pi * stretched_area(h, pupil)
    return s @ stretch_matrix(h, pupil), stretch * radius * radius


def edge_from_inside(
    azimuth_rad: Float[Array, " rays"],
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
    sharpness: float = SHARPNESS,
) -> tuple[Float[Array, "2"], Float[Array, "rays 2"], Float[Array, " rays"]]:
    """A point s inside the opening, directions from it, and how far the edge is."""
    outward = jnp.stack([jnp.cos(azimuth_rad), jnp.sin(azimuth_rad)], -1)
    centre = _inner_point(h, stop_radius, pupil)
    return centre, outward, _radius(outward, centre, h, stop_radius, pupil, sharpness)


def places_in_stop(
    u: Float[Array, "rays 2"],
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
) -> tuple[Float[Array, "rays 2"], Float[Array, " rays"]]:
    """Where rays pass the stop, from its middle and in its radii, x right and y down;
    and how far away its edge is in the direction of each.

    Parameters
    ----------
    u : As `pupil_rays` gives them.
    """
    middle = middle_of_stop(h, stop_radius, pupil)
    s = u @ jnp.linalg.inv(stretch_matrix(h, pupil)) - middle[None]
    length = jnp.sqrt(jnp.sum(s * s, -1) + 1e-24)
    outward, nowhere = s / length[:, None], jnp.zeros_like(h)
    a, b, c = _stop_edges(outward, nowhere, stop_radius, pupil, SHARPNESS)
    inverse = (b + _root(b * b - (4 * a * c)[None])) / (-2 * c)[None]
    edge = _nearest(inverse, SHARPNESS)
    return s / stop_radius, edge / stop_radius


def nearest_in_opening(
    u: Float[Array, "rays 2"],
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
) -> tuple[Float[Array, "rays 2"], Bool[Array, " rays"]]:
    """Rays, or those at the edge of the opening on the way to them from inside; and
    which rays the opening lets through.

    Parameters
    ----------
    u : As `pupil_rays` gives them.
    """
    matrix = stretch_matrix(h, pupil)
    inner = _inner_point(h, stop_radius, pupil)
    away = u @ jnp.linalg.inv(matrix) - inner[None]
    length = jnp.sqrt(jnp.sum(away * away, -1) + 1e-24)
    outward = away / length[:, None]
    edge = _radius(outward, inner, h, stop_radius, pupil, SHARPNESS)
    inside = length <= edge
    at_edge = (inner[None] + outward * edge[:, None]) @ matrix
    return jnp.where(inside[:, None], u, at_edge), inside


def opening_area(
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
    sharpness: float = SHARPNESS,
) -> Float[Array, ""]:
    """Area of the opening in u, by the trapezoidal rule over azimuths."""
    azimuth = np.arange(AREA_AZIMUTHS) * (2 * np.pi / AREA_AZIMUTHS)
    outward = jnp.asarray(np.stack([np.cos(azimuth), np.sin(azimuth)], -1), h.dtype)
    centre = _inner_point(h, stop_radius, pupil)
    radius = _radius(outward, centre, h, stop_radius, pupil, sharpness)
    stretch = jnp.exp(jnp.sum(_log_stretch(h, pupil)))
    return jnp.pi * jnp.mean(radius * radius) * stretch


def relative_illumination(
    h: Float[Array, "2"], stop_radius: Float[Array, ""], pupil: Pupil
) -> Float[Array, ""]:
    """Brightness of an evenly lit chart's image, 1 on the axis."""
    axis = jnp.zeros_like(h)
    here = opening_area(h, stop_radius, pupil)
    return here / opening_area(axis, stop_radius, pupil)


def width_along_field(
    h: Float[Array, "2"], stop_radius: Float[Array, ""], pupil: Pupil
) -> Float[Array, ""]:
    """How much stop and rims leave of the line through their middles, off the axis;
    negative where they leave nothing."""
    outward = h / jnp.sqrt(h @ h)
    centre, radius = _rims(h, pupil)
    rims_at, stop_at = centre @ outward, middle_of_stop(h, stop_radius, pupil) @ outward
    low = jnp.max(rims_at - radius, initial=stop_at - stop_radius)
    high = jnp.min(rims_at + radius, initial=stop_at + stop_radius)
    return high - low


def stretch_matrix(h: Float[Array, "2"], pupil: Pupil) -> Float[Array, "2 2"]:
    """S(h), which turns stop coordinates into direction cosines (a row times it)."""
    along, across = _log_stretch(h, pupil)
    square = h @ h
    # (e^along - e^across) h h' / |h|^2 without the division: both exponents hold |h|^2.
    safe = jnp.where(square > _FAR, square, 1.0)
    first = pupil.stretch[0, 0] - pupil.stretch[1, 0]
    second = pupil.stretch[0, 1] - pupil.stretch[1, 1]
    near = first + square * (second + (along + across) / 2 * second + first * first / 2)
    ratio = jnp.where(square > _FAR, (jnp.exp(along) - jnp.exp(across)) / safe, near)
    field = jnp.exp(across) * jnp.eye(2, dtype=h.dtype) + ratio * jnp.outer(h, h)
    half = jnp.exp(pupil.squeeze / 2)
    return field * jnp.stack([half, 1 / half])[None]


def stretched_area(h: Float[Array, "2"], pupil: Pupil) -> Float[Array, ""]:
    """The area in u of one unit of area in s."""
    return jnp.exp(jnp.sum(_log_stretch(h, pupil)))


def _log_stretch(h: Array, pupil: Pupil) -> Array:
    square = h @ h
    return pupil.stretch @ jnp.stack([square, square * square])


def _rims(h: Array, pupil: Pupil) -> tuple[Array, Array]:
    """Centres (rims, 2) and radii of the rims."""
    square = h @ h
    shift = pupil.rim_shift[:, 0] + pupil.rim_shift[:, 1] * square
    radius = pupil.rim_radius[:, 0] + pupil.rim_radius[:, 1] * square
    return jnp.outer(shift, h), radius


def middle_of_stop(h: Array, stop_radius: Array, pupil: Pupil) -> Array:
    """Quadratic in the pupil, so that it fades as the stop closes."""
    shift = pupil.stop_shift[0] + pupil.stop_shift[1] * (h @ h)
    return h * shift * stop_radius**2


def _inner_point(h: Array, stop_radius: Array, pupil: Pupil) -> Array:
    """A point well inside the opening.

    The middle of what stop and one rim leave of the line through their centres, summed
    over the rims: exact where one rim cuts from one side, another from the other.
    """
    centre, radius = _rims(h, pupil)
    stop_centre = middle_of_stop(h, stop_radius, pupil)
    centre = centre - stop_centre[None]
    distance = jnp.sqrt(jnp.sum(centre * centre, -1) + 1e-12)
    soft = 0.05 * stop_radius

    def smaller(a, b):
        return (a + b - jnp.sqrt((a - b) ** 2 + soft**2)) / 2

    high = smaller(stop_radius, distance + radius)
    low = -smaller(stop_radius, radius - distance)
    middle = jnp.sum(((high + low) / 2 / distance)[:, None] * centre, 0)
    return stop_centre + middle


def _radius(
    outward: Array,
    centre: Array,
    h: Array,
    stop_radius: Array,
    pupil: Pupil,
    sharpness: float,
) -> Array:
    """Distance from `centre` to the edge of the opening along each direction."""
    rim_centre, rim_radius = _rims(h, pupil)
    one = jnp.ones_like(rim_radius)
    relative = centre[None] - rim_centre
    quadratic = [one]
    linear = [2 * outward @ relative.T]
    constant = [jnp.sum(relative**2, -1) - rim_radius**2]
    stop_centre = middle_of_stop(h, stop_radius, pupil)
    stop = _stop_edges(outward, centre - stop_centre, stop_radius, pupil, sharpness)
    quadratic.append(stop[0])
    linear.append(stop[1])
    constant.append(stop[2])
    a = jnp.concatenate(quadratic)
    b = jnp.concatenate(linear, 1)
    # A centre outside a boundary (an opening that has closed) is led back smoothly.
    c = jnp.concatenate(constant)
    inside = (jnp.sqrt(c * c + _FAR**2) - c) / 2
    root = _root(b * b + (4 * a * inside)[None])
    inverse = (b + root) / (2 * inside)[None]
    return _nearest(inverse, sharpness)


def _stop_edges(
    outward: Array,
    centre: Array,
    stop_radius: Array,
    pupil: Pupil,
    sharpness: float,
) -> tuple[Array, Array, Array]:
    """a, b, c of a t^2 + b t + c = 0 at each arc of the stop along each direction.

    An arc of curvature k at distance d from the stop's centre, with normal n, is
    k |s|^2 / 2 + (1 - k d) n.s - d + k d^2 / 2 = 0: a circle about the centre for
    k = 1/d, a straight line for k = 0.
    """
    curvature, used, sector = blade_sectors(pupil)
    turn = pupil.blade_rotation_rad + sector / 2
    azimuth = turn + sector * jnp.arange(MOST_BLADES, dtype=centre.dtype)
    normal = jnp.stack([jnp.cos(azimuth), jnp.sin(azimuth)], -1)
    d = stop_radius * blade_apothem(pupil, sharpness)
    k = curvature / d
    ahead = 1 - curvature
    a = jnp.where(used, k / 2, 0.0)
    b = (k * outward @ centre)[:, None] + ahead * (outward @ normal.T)
    c = k / 2 * (centre @ centre) - d + k * d * d / 2 + ahead * (normal @ centre)
    # What is no blade is met nowhere.
    return a, jnp.where(used[None], b, 0.0), jnp.where(used, c, -1.0)


def blade_sectors(pupil: Pupil) -> tuple[Array, Array, Array]:
    """Curvature, which of the arcs exist, and the angle between them.

    Fewer than three make a circle: a single arc.
    """
    count = jnp.where(pupil.blades < 3, 1.0, pupil.blades)
    curvature = jnp.where(pupil.blades < 3, 1.0, pupil.blade_curvature)
    used = jnp.arange(MOST_BLADES, dtype=count.dtype) < count
    return curvature, used, 2 * math.pi / count


def blade_apothem(pupil: Pupil, sharpness: float) -> Array:
    """Distance of the blades' middles that gives the opening the area of the unit disc.

    By quadrature over half a sector, the smooth corners included. From the centre, an
    arc of curvature k at unit distance is met at the inverse radius
    (b + sqrt(b^2 + 2 k (1 - k/2))) / (2 - k), b = (1 - k) cos(angle to its normal).
    """
    curvature, used, sector = blade_sectors(pupil)
    nodes, weights = (
        jnp.asarray(part, curvature.dtype)
        for part in np.polynomial.legendre.leggauss(12)
    )
    angle = (nodes + 1) / 4 * sector
    blade = jnp.arange(MOST_BLADES, dtype=curvature.dtype)
    turned = jnp.cos(angle[:, None] - sector * blade[None])
    c = 1 - curvature / 2
    b = (1 - curvature) * turned
    inverse = (b + _root(b * b + 2 * curvature * c)) / (2 * c)
    radius = _nearest(jnp.where(used[None], inverse, 0.0), sharpness)
    return 1 / jnp.sqrt(weights / 2 @ radius**2)


def _root(square: Array) -> Array:
    """Its square root; next to nothing where a hollow blade is not met at all."""
    return jnp.sqrt(jnp.maximum(square, 0.0) + _FAR**2)


def _nearest(inverse: Array, sharpness: float) -> Array:
    """The smallest of several radii, given as inverses (directions, boundaries)."""
    inverse = jnp.maximum(inverse, _FAR)
    largest = jnp.max(inverse, -1)
    share = (inverse / largest[:, None]) ** _exponent(sharpness)
    return 1 / (largest * jnp.sum(share, -1) ** (1 / sharpness))


def _exponent(sharpness: float) -> float | int:
    """A whole one as such: seven squarings take a tenth of the time of a power."""
    return int(sharpness) if sharpness == int(sharpness) else sharpness
