"""The depth of a plate: its channel, its unit, and focus on the object at a pixel.

Options count most, then the plate's header, then the assumption that a channel holds
perpendicular metres; every assumption is noted. Header entries that are read (with any
prefix): ``depth/unit`` (mm, cm, m, in, ft, or millimetres as a number), ``depth/kind``,
``depth/near``, ``depth/far``, and USD's ``metersPerUnit``.

A plate that was lit and framed for a focus distance shows something near it. Where all
of its depth is far out of focus, and would not be in another unit, that unit is named.
A single element of a composite may be out of focus as a whole, so this is a note.

The depth of a plate is measured from the pinhole of the CG camera
(`lensfit.plate.camera.plate_state` converts it to a focus distance).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
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
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_deep import DeepPart, is_deep, read_deep
from lensfit.plate.plate_file import header_entries
from lensfit.rendering.circle import Circle
from lensfit.rendering.uv import PlateGeometry
from lensfit.units import MILLIMETRES_PER_METRE

if TYPE_CHECKING:
    from lensfit.rendering.uv import PlateGeometry

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


FOCUS_AT = "--focus-at"
_REMEDY = "give --focus-at another pixel or region, or --focus-distance-mm"


def picked_region(pick: tuple[float, ...], display: Window) -> Window:
    """The pixels of a pick: the one that holds x, y, or those whose centre lies
    between x0, y0 and x1, y1, counted from the display window's corner.

    Raises
    ------
    ImageError : The region holds no pixel, or none of the display window.
    """
    if len(pick) not in (2, 4) or not all(map(math.isfinite, pick)):
        raise ImageError(
            "--focus-at is no pixel and no region", remedy="write X,Y or X0,Y0,X1,Y1"
        )
    if len(pick) == 2:
        x, y = map(math.floor, pick)
        low, high = (x, y), (x, y)
    else:
        xs, ys = sorted(pick[::2]), sorted(pick[1::2])
        low = math.ceil(xs[0] - 0.5), math.ceil(ys[0] - 0.5)
        high = math.ceil(xs[1] - 0.5) - 1, math.ceil(ys[1] - 0.5) - 1
    region = Window(
        max(low[0], 0) + display.x_min,
        max(low[1], 0) + display.y_min,
        min(high[0], display.width - 1) + display.x_min,
        min(high[1], display.height - 1) + display.y_min,
    )
    if region.width < 1 or region.height < 1:
        shown = ",".join(f"{number:g}" for number in pick)
        raise ImageError(
            f"--focus-at {shown} holds no pixel of the {display.width} x "
            f"{display.height} frame",
            remedy="count pixels from the frame's upper left corner",
        )
    return region


def picked_depth_mm(
    image: ExrImage,
    path: Path,
    pick: tuple[float, ...],
    options: DepthOptions,
    geometry: "PlateGeometry",
    focal_length_mm: float,
) -> tuple[float, tuple[str, ...]]:
    """Perpendicular distance from the pinhole of what was picked, and what was assumed:
    the median of a region, of the pixels that hold something.

    Parameters
    ----------
    image : The plate; read again if it is its header alone.
    path : Its file; a deep one is seen from the front.
    options : What the user states about depth.
    geometry, focal_length_mm : Of the plate and its CG camera, for ray distance.

    Raises
    ------
    ImageError : The plate has no depth, or only sky there.
    """
    if not any(part.channels for part in image.parts):
        image = _front(read_deep(path), options) if is_deep(path) else read_exr(path)
    beside = image.parts[0]
    found = find_depth(image, options.channel, beside)
    if found is None:
        raise ImageError(
            "has no depth channel, which --focus-at needs",
            remedy="render Z, or name its channel with --depth-channel",
        )
    region = picked_region(pick, beside.display_window)
    meaning, notes = depth_meaning(image, found, options)
    samples = depth_over_window(_part_of_region(found, region), found.name, region)
    slant = 1.0
    if meaning.kind == "ray":
        slant = ray_slant(geometry.mm(region.pixel_centres()), focal_length_mm)
    depth = perpendicular_mm(samples, meaning, slant)
    valid = depth[np.isfinite(depth)]
    if valid.size == 0:
        what = "only sky" if np.isposinf(depth).any() else "no depth"
        shown = ",".join(f"{number:g}" for number in pick)
        raise ImageError(f"has {what} at --focus-at {shown}", remedy=_REMEDY)
    return float(np.median(valid)), notes


def _part_of_region(found: FoundDepth, region: Window) -> ExrPart:
    """The part as far as the region needs it, with its depth alone."""
    own = found.part.data_window
    low = np.maximum(region[:2], own[:2])
    high = np.minimum(region[2:], own[2:])
    if (low > high).any():
        low, high = np.array(own[:2]), np.array(own[:2])
    rows = slice(low[1] - own.y_min, high[1] - own.y_min + 1)
    columns = slice(low[0] - own.x_min, high[0] - own.x_min + 1)
    samples = found.part.channels[found.name][rows, columns]
    window = Window(*map(int, (*low, *high)))
    return ExrPart({found.name: samples}, window, found.part.display_window, {})


def _front(deep: DeepPart, options: DepthOptions) -> ExrImage:
    """A deep plate's nearest samples that show anything, as a flat one's depth."""
    name, flat = options.channel or "Z", deep.flat
    if name not in deep.samples:
        return ExrImage((flat,))
    counts = deep.counts.ravel()
    own = np.repeat(np.arange(counts.size), counts)
    seen = np.asarray(deep.samples.get("A", np.ones(len(own)))) > 0
    samples = deep.samples[name][seen].astype(np.float32)
    meaning, _ = depth_meaning(ExrImage((flat,)), FoundDepth(flat, name), options)
    inverse = meaning.kind == "inverse"
    plane: Float32[np.ndarray, " pixels"] = np.full(counts.size, np.inf, np.float32)
    if inverse:
        plane[:] = 0
    (np.maximum if inverse else np.minimum).at(plane, own[seen], samples)
    channels = {name: plane.reshape(deep.counts.shape)}
    part = ExrPart(channels, flat.data_window, flat.display_window, flat.attributes)
    return ExrImage((part,))
