"""What types cannot say about a blur block: terms that exist, and light everywhere.

Stop and rims are discs with their centres on the line through the field point, so that
they leave an opening exactly where the pieces they cut from that line overlap
(`lensfit.optics.pupil` has the formulas). Both are looked at from the axis to the
furthest corner of the sensor, for the reference stop and every measured one.
"""

from collections.abc import Iterator

import msgspec

from lensfit.preset.blur_blocks import AberrationTerm, Blur, Pupil

_RADII = 32
_LONGEST_BY_COLOUR = 2


def blur_faults(blur: Blur, frame_radius_mm: float) -> Iterator[tuple[str, str]]:
    """Key and sentence of everything in a block that cannot be right."""
    seen: set[AberrationTerm] = set()
    for index, term in enumerate(blur.aberrations):
        for key, what in _term_faults(term):
            yield f"aberrations[{index}].{key}", what
        bare = msgspec.structs.replace(term, um=0.0, um_by_colour=())
        if bare in seen:
            yield f"aberrations[{index}]", "stands twice"
        seen.add(bare)
    stops = [stop.f_number for stop in blur.stops]
    if len(set(stops)) < len(stops):
        yield "stops", "an f-number stands twice"
    if blur.pupil.blades in (1, 2):
        yield "pupil.blades", "is no iris; 0 is round, 3 and more are blades"
    if blur.uncertainty is not None:
        count = len(blur.uncertainty.numbers)
        for index, move in enumerate(blur.uncertainty.moves):
            if len(move) != count:
                what = f"has {len(move)} numbers for {count} names"
                yield f"uncertainty.moves[{index}]", what
    yield from _pupil_faults(blur, frame_radius_mm / blur.field_radius_mm)


def _term_faults(term: AberrationTerm) -> Iterator[tuple[str, str]]:
    if term.order > term.degree or (term.degree - term.order) % 2:
        yield "order", f"does not go with degree {term.degree}"
    field = abs(term.field_order)
    if field > term.field_degree or (term.field_degree - field) % 2:
        yield "field_order", f"does not go with field_degree {term.field_degree}"
    if term.part == "im" and not (term.order or term.field_order):
        yield "part", 'is zero everywhere: a term of order 0 has only "re"'
    if len(term.um_by_colour) > _LONGEST_BY_COLOUR:
        yield "um_by_colour", f"has more than {_LONGEST_BY_COLOUR} coefficients"


def _pupil_faults(blur: Blur, furthest: float) -> Iterator[tuple[str, str]]:
    """Radii and overlap, up to the furthest field point."""
    radii = [1.0] + [
        stop.radius_ratio / (2 * stop.f_number * blur.reference_sine)
        for stop in blur.stops
    ]
    for step in range(_RADII + 1):
        h = furthest * step / _RADII
        where = f"{h * blur.field_radius_mm:.3g} mm off the axis, inside the frame"
        for index, rim in enumerate(blur.pupil.rims):
            if rim.radius[0] + rim.radius[1] * h * h <= 0:
                yield f"pupil.rims[{index}].radius", f"is not positive {where}"
                return
        if any(_is_closed(blur.pupil, h, radius) for radius in radii):
            yield "pupil", f"lets no light through {where}"
            return


def _is_closed(pupil: Pupil, h: float, stop_radius: float) -> bool:
    shift = pupil.stop_shift[0] + pupil.stop_shift[1] * h * h
    centre = h * shift * stop_radius**2
    low, high = centre - stop_radius, centre + stop_radius
    for rim in pupil.rims:
        centre = h * (rim.shift[0] + rim.shift[1] * h * h)
        radius = rim.radius[0] + rim.radius[1] * h * h
        low, high = max(low, centre - radius), min(high, centre + radius)
    return low >= high
