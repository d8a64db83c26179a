"""Convert a preset's blur block to the optics, and back.

The file lists each term of the aberration function with its change by colour, and the
pupil's squeeze as a ratio; the optics keep arrays in the order of their terms, colour
apart, and the logarithm of the squeeze. Nothing else is converted.

`lens_blur` then sets f-number and focus. The radius of a stop that was not photographed
follows its f-number, corrected by interpolation between the photographed stops. A focus
distance that was not photographed is reached by first-order optics: the image plane
moves as if the whole lens did (unit focusing).

Any number of a block can be changed by its name, which is the path to it in the file.
In lists whose order means nothing, a member is named by its identity: a term of the
aberration function by part, degree, order, field degree and field order, a stop by its
f-number:

    focus_offset_mm
    pupil.rims[0].shift[1]
    aberrations[re 3 1 1 1].um
    stops[f/2.8].radius_ratio
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import jax.numpy as jnp
import msgspec
import numpy as np

from lensfit.optics.aberration import Aberration
from lensfit.optics.paraxial import (
    defocus_mm,
    first_order_of,
    rim_sine,
)
from lensfit.optics.pupil import Pupil
from lensfit.optics.spectrum import CENTRES_NM, WIDTHS_NM, bands
from lensfit.optics.terms import Term
from lensfit.preset import blocks
from lensfit.preset.entry import Entry
from lensfit.preset.photographed_stops import radius_ratio
from lensfit.psf.lens_blur import LensBlur

_TERM = ("part", "degree", "order", "field_degree", "field_order")


def numbers_of(blur: blocks.Blur) -> dict[str, float]:
    """Every number of a block that is no count, by its name."""
    return dict(_numbers(_tables(blur), ""))


def with_moves(blur: blocks.Blur, moves: Mapping[str, float]) -> blocks.Blur:
    """The block with some numbers moved; a name that it lacks moves nothing.

    Raises
    ------
    ValueError : A number leaves the range it may have.
    """
    moved = _mapped_numbers(
        _tables(blur), "", lambda name, v: v + float(moves.get(name, 0.0))
    )
    try:
        found = msgspec.convert(moved, blocks.Blur)
    except msgspec.ValidationError as error:
        raise ValueError(f"no blur can be so: {error}") from error
    return msgspec.structs.replace(found, uncertainty=blur.uncertainty)


def _tables(blur: blocks.Blur) -> dict[str, Any]:
    return msgspec.to_builtins(msgspec.structs.replace(blur, uncertainty=None))


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    for inner, item in _inside(value, name):
        if isinstance(item, float) and math.isfinite(item):
            yield inner, item
        else:
            yield from _numbers(item, inner)


def _mapped_numbers(
    value: Any, name: str, change: Callable[[str, float], float]
) -> Any:
    if isinstance(value, float):
        return change(name, value)
    items = [
        _mapped_numbers(item, inner, change) for inner, item in _inside(value, name)
    ]
    if isinstance(value, dict):
        return dict(zip(value, items, strict=True))
    return items if isinstance(value, (list, tuple)) else value


def _inside(value: Any, name: str) -> list[tuple[str, Any]]:
    """Name and value of everything in a table or a list; nothing in anything else."""
    if isinstance(value, dict):
        dot = "." if name else ""
        return [(f"{name}{dot}{key}", item) for key, item in value.items()]
    if isinstance(value, (list, tuple)):
        return [(f"{name}[{_key(k, item)}]", item) for k, item in enumerate(value)]
    return []


def _key(index: int, item: Any) -> str:
    if isinstance(item, dict) and "field_degree" in item:
        return " ".join(str(item[key]) for key in _TERM)
    if isinstance(item, dict) and "f_number" in item:
        return f"f/{item['f_number']:g}"
    return str(index)


ROUND_SLACK = 1.02
"""Blades show above this times the widest round f-number."""
_COLOURS = 2


def blur_block(
    aberration: Aberration,
    pupil: Pupil,
    *,
    pupil_magnification: float,
    reference_distance_mm: float,
    focus_offset_mm: float,
    stops: Iterable[blocks.Stop],
    round_f_number: float,
    band_centres_nm: tuple[float, float, float] = CENTRES_NM,
    band_widths_nm: tuple[float, float, float] = WIDTHS_NM,
    assumed: tuple[str, ...] = (),
    beyond_offset_mm: float | None = None,
) -> blocks.Blur:
    """The block that describes this optics in a file; see `blocks.Blur`."""
    return blocks.Blur(
        aberrations=_terms_of(aberration),
        field_radius_mm=float(aberration.field_radius_mm),
        reference_sine=float(aberration.reference_sine),
        exit_pupil_distance_mm=float(aberration.exit_pupil_distance_mm),
        chief_bend=float(aberration.chief_bend),
        pupil_magnification=float(pupil_magnification),
        reference_distance_mm=float(reference_distance_mm),
        focus_offset_mm=float(focus_offset_mm),
        pupil=_pupil_block(pupil),
        stops=tuple(sorted(stops, key=lambda stop: stop.f_number)),
        band_centres_nm=_three(band_centres_nm),
        band_widths_nm=_three(band_widths_nm),
        round_f_number=float(round_f_number),
        assumed=tuple(assumed),
        beyond_offset_mm=beyond_offset_mm,
    )


def aberration_of(blur: blocks.Blur) -> Aberration:
    """The aberration function of a block."""
    terms = tuple(_term(t) for t in blur.aberrations)
    coloured = [t for t in blur.aberrations if t.um_by_colour]
    colour = [(*t.um_by_colour, 0.0)[:_COLOURS] for t in coloured]
    return Aberration(
        coefficients_um=_array([t.um for t in blur.aberrations]),
        colour_um=_array(colour).reshape(-1, _COLOURS).T,
        field_radius_mm=_array(blur.field_radius_mm),
        reference_sine=_array(blur.reference_sine),
        exit_pupil_distance_mm=_array(blur.exit_pupil_distance_mm),
        chief_bend=_array(blur.chief_bend),
        terms=terms,
        colour_terms=tuple(_term(t) for t in coloured),
    )


def pupil_of(pupil: blocks.Pupil, *, bladed: bool = True) -> Pupil:
    """The opening of a block; without its blades where the stop is wide open."""
    return Pupil(
        rim_shift=_array([rim.shift for rim in pupil.rims]).reshape(-1, 2),
        rim_radius=_array([rim.radius for rim in pupil.rims]).reshape(-1, 2),
        stop_shift=_array(pupil.stop_shift),
        stretch=_array([pupil.stretch_along, pupil.stretch_across]),
        squeeze=_array(math.log(pupil.squeeze)),
        blade_rotation_rad=_array(pupil.blade_rotation_rad),
        blade_curvature=_array(pupil.blade_curvature),
        blades=pupil.blades if bladed else 0,
    )


def lens_blur(
    entry: Entry, f_number: float, measured_focus_mm: float | None
) -> LensBlur:
    """The blur of an entry that has one, at an f-number and the entry's focus.

    Parameters
    ----------
    measured_focus_mm : Focus distance that the entry's numbers hold for; None when
        nobody said: then the lens counts as focused at the reference distance, and is
        sharp where the entry's focus says, if it says so.
    """
    blur, projection = entry.blur, entry.projection
    if blur is None:
        raise ValueError("the entry has no blur")
    reference = _array(blur.reference_distance_mm)
    held_mm = measured_focus_mm or blur.reference_distance_mm
    focus_mm = entry.focus_distance_mm or held_mm
    first_order = first_order_of(
        _array(projection.principal_distance_mm),
        _array(blur.pupil_magnification),
        _array(projection.entrance_pupil_offset_mm),
        _array(held_mm),
    )
    # A focus that nobody stated is what the offset measures; a stated one replaces it.
    stated = measured_focus_mm is None and entry.focus_distance_mm is not None
    beyond = 0.0 if stated else blur.focus_offset_mm
    nominal = rim_sine(first_order, _array(f_number), reference)
    ratio = radius_ratio(blur.stops, f_number) / blur.reference_sine
    bladed = f_number > ROUND_SLACK * blur.round_f_number
    along_y = section_ratio(entry) if blur.beyond_offset_mm is not None else 1.0
    defocus = defocus_mm(first_order, _array(focus_mm), reference)
    return LensBlur(
        aberration=aberration_of(blur),
        pupil=pupil_of(blur.pupil, bladed=bladed),
        first_order=first_order,
        reference_distance_mm=reference,
        defocus_mm=along_y * defocus + beyond,
        stop_radius=nominal * ratio,
        bands=bands(3, blur.band_centres_nm, blur.band_widths_nm),
        beyond_mm=None
        if blur.beyond_offset_mm is None
        else _array(blur.beyond_offset_mm),
    )


def section_ratio(entry: Entry) -> float:
    """Defocus of the section along y over that of the mean of both sections.

    First-order optics is that of the geometric mean of both principal distances, of
    which defocus goes as the square.
    """
    distortion = entry.distortion
    return distortion.squeeze ** math.cos(2 * distortion.squeeze_axis_rad)


def _terms_of(aberration: Aberration) -> tuple[blocks.AberrationTerm, ...]:
    """Every term once; one that is there for its colour alone has 0 um."""
    um = dict(zip(aberration.terms, _floats(aberration.coefficients_um), strict=True))
    rows = np.asarray(aberration.colour_um, float).T.tolist()
    by_colour = dict(zip(aberration.colour_terms, rows, strict=True))
    return tuple(
        blocks.AberrationTerm(
            degree=term.degree,
            order=term.order_u,
            field_degree=term.field_degree,
            field_order=term.field_order,
            part=term.part,
            um=um.get(term, 0.0),
            um_by_colour=tuple(by_colour.get(term, ())),
        )
        for term in dict.fromkeys((*aberration.terms, *aberration.colour_terms))
    )


def _pupil_block(pupil: Pupil) -> blocks.Pupil:
    rims = zip(np.asarray(pupil.rim_shift), np.asarray(pupil.rim_radius), strict=True)
    along, across = np.asarray(pupil.stretch)
    return blocks.Pupil(
        rims=tuple(blocks.Rim(_pair(shift), _pair(radius)) for shift, radius in rims),
        stop_shift=_pair(pupil.stop_shift),
        stretch_along=_pair(along),
        stretch_across=_pair(across),
        squeeze=math.exp(float(pupil.squeeze)),
        blades=round(float(pupil.blades)),
        blade_rotation_rad=float(pupil.blade_rotation_rad),
        blade_curvature=float(pupil.blade_curvature),
    )


def _term(term: blocks.AberrationTerm) -> Term:
    return Term(term.degree, term.order, term.field_degree, term.field_order, term.part)


def _array(values):
    return jnp.asarray(np.asarray(values, float))


def _floats(values) -> list[float]:
    return np.asarray(values, float).tolist()


def _pair(values) -> tuple[float, float]:
    first, second = _floats(values)
    return first, second


def _three(values) -> tuple[float, float, float]:
    r, g, b = _floats(values)
    return r, g, b
