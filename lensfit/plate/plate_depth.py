"""The depth of a plate: its channel, its unit, and how it is measured.

Options count most, then the plate's header, then the assumption that a channel holds
perpendicular metres; every assumption is noted. Header entries that are read (with any
prefix): ``depth/unit`` (mm, cm, m, in, ft, or millimetres as a number), ``depth/kind``,
``depth/near``, ``depth/far``, and USD's ``metersPerUnit``.

A plate that was lit and framed for a focus distance shows something near it. Where all
of its depth is far out of focus, and would not be in another unit, that unit is named.
A single element of a composite may be out of focus as a whole, so this is a note.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from lensfit.errors import ImageError
from lensfit.io.depth_channel import (
    KINDS,
    UNITS_MM,
    DepthKind,
    DepthMeaning,
    FoundDepth,
    depth_over_window,
    find_depth,
    perpendicular_mm,
    ray_slant,
    unit_in_mm,
    without_nan,
)
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.plate.plate_file import header_entries
from lensfit.rendering.circle import Circle
from lensfit.rendering.uv import PlateGeometry
from lensfit.units import MILLIMETRES_PER_METRE

_LEAST_PX = 0.5
_PART_OF_WIDTH = 2e-3
"""Radius of blur, over the width of the frame, that is taken as out of focus."""


@dataclass(frozen=True)
class DepthOptions:
    """What the user states about depth; None leaves it to the plate.

    Attributes
    ----------
    channel : Exact name.
    unit : A unit's name, or its length in millimetres.
    kind : See `lensfit.io.depth_channel.DepthMeaning`.
    near, far : Planes of a normalised depth, in its unit.
    """

    channel: str | None = None
    unit: str | None = None
    kind: DepthKind | None = None
    near: float | None = None
    far: float | None = None


class PlateDepth(NamedTuple):
    """Depth over the data window of the colours, and what was assumed of it.

    Attributes
    ----------
    unit_mm : What a number of the channel was taken for.
    """

    depth_mm: Float32[np.ndarray, "height width"]
    notes: tuple[str, ...]
    unit_mm: float = MILLIMETRES_PER_METRE


def plate_depth(
    image: ExrImage,
    beside: ExrPart,
    options: DepthOptions,
    geometry: PlateGeometry,
    focal_length_mm: float,
) -> PlateDepth:
    """The depth of a plate.

    Parameters
    ----------
    image : The plate.
    beside : Its part with the colours, over whose data window depth is wanted.
    geometry : How the plate lies on the sensor.
    focal_length_mm : Of the CG camera.

    Raises
    ------
    ImageError : There is no depth channel, or not the one that was named; or an option
        or a header entry is no unit or kind.
    """
    found = find_depth(image, options.channel, beside)
    if found is None:
        raise ImageError(
            "has no depth channel, and depth of field needs one",
            remedy="render Z, or name its channel with --depth-channel; --no-defocus "
            "leaves depth of field out",
        )
    meaning, notes = depth_meaning(image, found, options)
    samples = depth_over_window(found.part, found.name, beside.data_window)
    slant = 1.0
    if meaning.kind == "ray":
        offsets = geometry.mm(beside.data_window.pixel_centres())
        slant = ray_slant(offsets, focal_length_mm)
    depth = perpendicular_mm(samples, meaning, slant)
    missing = float(np.mean(np.isnan(depth)))
    if missing > 0:
        instead = "the nearest pixel's is taken" if missing < 1 else "all is sky"
        notes += (f"{100 * missing:.3g} % of the depth is missing or NaN: {instead}",)
    elif np.isposinf(depth).all():
        notes += ("all of the depth is zero, negative, infinite or huge: all is sky",)
    return PlateDepth(without_nan(depth), notes, meaning.unit_mm)


def depth_meaning(
    image: ExrImage, found: FoundDepth, options: DepthOptions
) -> tuple[DepthMeaning, tuple[str, ...]]:
    """What the numbers of a channel say, and a note for what was assumed.

    Raises
    ------
    ImageError : An option or a header entry is no unit or kind.
    """
    header = header_entries(image) | dict(found.part.attributes)
    assumed = []
    unit_mm = _unit_mm(header, options)
    if unit_mm is None:
        unit_mm = MILLIMETRES_PER_METRE
        assumed.append("metres (--depth-unit)")
    kind = options.kind or _entry(header, "depth/kind")
    if kind is None:
        kind = "perpendicular"
        assumed.append("along the optical axis (--depth-kind)")
    if not isinstance(kind, str):
        raise ImageError(
            f"depth/kind of the header is no word but {_type_word(kind)}",
            remedy=f"give one of {', '.join(KINDS)} with --depth-kind",
        )
    if kind not in KINDS:
        source = "--depth-kind" if options.kind else "depth/kind of the header"
        raise ImageError(
            f"{' '.join(repr(kind).split())[:40]} is no kind of depth ({source})",
            remedy=f"give one of {', '.join(KINDS)} with --depth-kind",
        )
    planes = {"near": 0.0, "far": 1.0}
    for name in planes:
        stated = getattr(options, name)
        stated = _entry(header, f"depth/{name}") if stated is None else stated
        if stated is not None:
            planes[name] = _number(f"depth/{name}", stated)
        elif kind == "normalised" and name == "far":
            raise ImageError(
                "has a normalised depth without its planes",
                remedy="give --depth-near and --depth-far",
            )
    notes = ()
    if assumed:
        notes = (f"depth {found.name!r} is taken as {', '.join(assumed)}",)
    return DepthMeaning(unit_mm, kind, **planes), notes


def depth_doubt(
    depth_mm: Float32[np.ndarray, "*shape"],
    circle: Circle,
    unit_mm: float,
    width_px: int,
) -> str | None:
    """Whether the depths put everything out of focus; None if something is in focus.

    Parameters
    ----------
    depth_mm : Perpendicular, from the pinhole; infinite for the sky.
    circle : Of confusion, of the lens at the state of the plate.
    unit_mm : What a number of the depth channel was taken for.
    width_px : Of the frame.
    """
    finite = depth_mm[np.isfinite(depth_mm)]
    if finite.size == 0 or circle.px_mm == 0:
        return None
    near_mm, far_mm = float(finite.min()), float(finite.max())
    focus_mm = circle.depth_mm(0.0)
    most_px = max(_LEAST_PX, _PART_OF_WIDTH * width_px)

    def in_focus(scale: float) -> bool:
        ends_mm = np.array([near_mm, far_mm], np.float32) * np.float32(scale)
        if ends_mm[0] <= focus_mm <= ends_mm[1]:
            return True
        return bool(np.abs(circle.radius_px(ends_mm)).min() <= most_px)

    has_sky = finite.size < depth_mm.size
    sky_px = abs(float(circle.radius_px(np.full(1, np.inf, np.float32))[0]))
    if in_focus(1.0) or (has_sky and sky_px <= most_px):
        return None
    others = [name for name, mm in UNITS_MM.items() if in_focus(mm / unit_mm)]
    remedy = f"in {' or '.join(others)} it would be" if others else "check the unit"
    return (
        f"nothing is in focus: depth lies between {near_mm:g} and {far_mm:g} mm, the "
        f"focus at {focus_mm:g} mm from the pinhole; {remedy} (--depth-unit, "
        "--focus-distance-mm)"
    )


def _unit_mm(header: Mapping[str, object], options: DepthOptions) -> float | None:
    unit = options.unit or _entry(header, "depth/unit")
    if unit is not None:
        source = "--depth-unit" if options.unit else "depth/unit of the header"
        if not isinstance(unit, (str, int, float)):
            raise ImageError(
                f"depth/unit of the header is no unit but {_type_word(unit)}",
                remedy="state it with --depth-unit",
            )
        try:
            return unit_in_mm(str(unit))
        except ImageError as error:
            raise ImageError(f"{error.what} ({source})", remedy=error.remedy) from None
    metres = _entry(header, "metersPerUnit")
    if metres is None:
        return None
    return _number("metersPerUnit", metres) * MILLIMETRES_PER_METRE


def _type_word(value: object) -> str:
    """What kind of header entry it is, for people."""
    if isinstance(value, (int, float)):
        return "a number"
    return "a list or matrix" if hasattr(value, "__len__") else "another entry"


def _entry(header: Mapping[str, object], key: str):
    for name, value in header.items():
        if name == key or name.endswith(f"/{key}"):
            return value
    return None


def _number(key: str, value: object) -> float:
    try:
        return float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        raise ImageError(
            f"{key} is {str(value)[:40]!r} and should be a number",
            remedy="mend it, or state the value yourself",
        ) from None
