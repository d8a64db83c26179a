"""Parameters of the wavefront fit: one flat vector of named blocks.

Coefficients are micrometres of rms spot, defocus is millimetres on the sensor, the rest
plain numbers. Blocks:

- `coefficients`, `colour`: of the aberration function (`optics.aberration`);
- `focus_change`: how some of the coefficients change with the focus distance, for the
  photographed state farthest from the reference in vergence; elements that move against
  each other change aberrations, a lens that moves as a whole barely does;
- `defocus`: how far the sensor lies behind the sharp image of the chart, one for each
  group of takes that share focus and chart distance;
- `astigmatic_offset`: of the defocus of an anamorphic lens: its defocus along x minus
  the one at which x and y are sharp at one distance (`optics.depth`), one for each
  group too; other lenses have no such block;
- `exit_pupil`: logarithm of its distance over the principal distance, and the chief
  ray's bend;
- `band_width`: width of the bands of red, green and blue over the usual one
  (`optics.spectrum`), less one, the same of all: that of a camera is not known, and a
  lens whose focus changes with colour shows it. Negative widths are positive ones;
- `rim_shift`, `rim_radius`, `stop_shift`, `stretch`, `iris`: clipping apertures and
  pupil (`optics.pupil`); `iris` holds squeeze, rotation and curvature of the blades;
- `stop_ratio`: logarithm of each stop's radius over the one its f-number gives.

The coefficient of constant defocus has the same effect as all `defocus` values
together: it stays fixed (a gauge). A block is fixed or freed by its prior: a standard
deviation of zero fixes it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.optics.aberration import Aberration
from lensfit.optics.pupil import Pupil
from lensfit.optics.terms import Term


@dataclass(frozen=True)
class Layout:
    """Which numbers exist; static, so one program per layout.

    Attributes
    ----------
    terms, colour_terms : Of the aberration function.
    groups : Room for so many defocus values.
    stops : Room for so many f-numbers besides the widest.
    rims : Number of rims that clip.
    focus_terms : Those of the terms that may change with the focus distance.
    anamorphic : Whether x and y have separate defocus.
    """

    terms: tuple[Term, ...]
    colour_terms: tuple[Term, ...]
    groups: int
    stops: int
    rims: int = 2
    focus_terms: tuple[Term, ...] = ()
    anamorphic: bool = False

    @cached_property
    def blocks(self) -> dict[str, slice]:
        """Where each named block lies in the vector."""
        sizes = {
            "coefficients": len(self.terms),
            "colour": 2 * len(self.colour_terms),
            "focus_change": len(self.focus_terms),
            "defocus": self.groups,
            **({"astigmatic_offset": self.groups} if self.anamorphic else {}),
            "exit_pupil": 2,
            "band_width": 1,
            "rim_shift": 2 * self.rims,
            "rim_radius": 2 * self.rims,
            "stop_shift": 2,
            "stretch": 4,
            "iris": 3,
            "stop_ratio": self.stops,
        }
        ends = np.cumsum(list(sizes.values()))
        return {
            name: slice(int(end - size), int(end))
            for (name, size), end in zip(sizes.items(), ends, strict=True)
        }

    @property
    def size(self) -> int:
        """Length of the vector."""
        return self.blocks["stop_ratio"].stop

    @cached_property
    def focus_rows(self) -> Int[np.ndarray, " focus_terms"]:
        """Which of the terms these are."""
        return np.array([self.terms.index(term) for term in self.focus_terms], int)

    @property
    def pupil_parameters(self) -> slice:
        """All blocks of rims and stop, which are adjacent at the end."""
        return slice(self.blocks["rim_shift"].start, self.size)


class Scale(NamedTuple):
    """Constants that give the parameters their meaning; never fitted.

    Attributes
    ----------
    field_radius_mm : Unit of the field point, at the reference state.
    reference_sine : Direction cosine at the rim of the widest stop.
    principal_distance_mm : At the reference state.
    """

    field_radius_mm: Float[Array, ""]
    reference_sine: Float[Array, ""]
    principal_distance_mm: Float[Array, ""]


def aberration_of(
    parameters: Float[Array, " parameters"],
    layout: Layout,
    scale: Scale,
    principal_distance_ratio: Float[Array, ""] | float = 1.0,
    focus: Float[Array, ""] | float = 0.0,
) -> Aberration:
    """The aberration function the parameters describe.

    Parameters
    ----------
    principal_distance_ratio : Principal distance of a state over that of the reference
        state: the same ray lands further out where the sensor lies further back.
    focus : Focus coordinate (`FocusRange`).
    """
    part = {name: parameters[where] for name, where in layout.blocks.items()}
    distance = scale.principal_distance_mm * jnp.exp(part["exit_pupil"][0])
    change = focus * part["focus_change"]
    return Aberration(
        coefficients_um=part["coefficients"].at[layout.focus_rows].add(change),
        colour_um=part["colour"].reshape(2, -1),
        field_radius_mm=scale.field_radius_mm * principal_distance_ratio,
        reference_sine=scale.reference_sine,
        exit_pupil_distance_mm=distance * principal_distance_ratio,
        chief_bend=part["exit_pupil"][1],
        terms=layout.terms,
        colour_terms=layout.colour_terms,
    )


def pupil_of(
    pupil_parameters: Float[Array, " pupil"],
    layout: Layout,
    blades: Float[Array, ""],
) -> Pupil:
    """Rims and stop, from the numbers in `Layout.pupil_parameters`.

    `blades` is 0 where the stop is wide open.
    """
    rims = 2 * layout.rims
    iris = pupil_parameters[2 * rims + 6 : 2 * rims + 9]
    return Pupil(
        rim_shift=pupil_parameters[:rims].reshape(layout.rims, 2),
        rim_radius=pupil_parameters[rims : 2 * rims].reshape(layout.rims, 2),
        stop_shift=pupil_parameters[2 * rims : 2 * rims + 2],
        stretch=pupil_parameters[2 * rims + 2 : 2 * rims + 6].reshape(2, 2),
        squeeze=iris[0],
        blade_rotation_rad=iris[1],
        blade_curvature=iris[2],
        blades=blades,
    )


def fitted_stop_radius(
    pupil_parameters: Float[Array, " pupil"],
    layout: Layout,
    stated_radius: Float[Array, "*stops"],
    stop: Int[Array, "*stops"],
) -> Float[Array, "*stops"]:
    """Radius of a stop as it was set, in radii of the widest.

    Parameters
    ----------
    stated_radius : As its f-number says.
    stop : Its place among the f-numbers, 0 the widest, which is the unit.
    """
    ratios = pupil_parameters[pupil_parameters.shape[0] - layout.stops :]
    all_stops = jnp.concatenate([jnp.zeros(1, pupil_parameters.dtype), ratios])
    return stated_radius * jnp.exp(all_stops[stop])


def mirror_through_focus(
    parameters: Float[np.ndarray, " parameters"], layout: Layout
) -> Float[np.ndarray, " parameters"]:
    """The lens that draws nearly the same images from the other side of focus.

    Every ray lands where the one through the opposite point of the pupil did. The two
    differ only slightly: oblique cones, the light over the pupil and depth are not the
    same on both sides of focus.
    """
    blocks = layout.blocks
    found = parameters.copy()
    for name in ("defocus", "astigmatic_offset", "rim_shift", "stop_shift"):
        if name in blocks:
            found[blocks[name]] *= -1
    found[blocks["coefficients"]] *= _kept_by_mirror(layout.terms)
    found[blocks["focus_change"]] *= _kept_by_mirror(layout.focus_terms)
    found[blocks["colour"]] *= np.tile(_kept_by_mirror(layout.colour_terms), 2)
    found[blocks["iris"].start + 1] += np.pi
    return found


def _kept_by_mirror(terms: tuple[Term, ...]) -> np.ndarray:
    """1 for odd modes, such as coma, -1 for even ones."""
    return np.array([1.0 if term.degree % 2 else -1.0 for term in terms])
