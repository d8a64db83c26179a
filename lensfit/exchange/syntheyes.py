"""SynthEyes' lens information, ``.lni``: a table from true to distorted radius.

Radii count from the optic centre, in millimetres of the sensor where the root says
``mm="1"``, or else in half heights of the picture; between the samples lies a spline.
The table knows no centre, focal length or picture; lensfit writes them into the block
``lensfit``, which SynthEyes passes over.

Of a lens the table holds the mean over all azimuths: the distorted radius as an odd
polynomial of the true one, by least squares on the photograph, beyond the frame too, as
overscan reads on there.

Source: SynthEyes' manual, "Lens Information Files" and "Lens Distortion Profiles".
"""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import final
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
    export_result,
    lens_description,
    principal_point,
    samples_pair,
)
from lensfit.exchange.foreign import (
    ForeignLens,
    ForeignState,
    Points,
    StatedValues,
    inverse_points,
)
from lensfit.exchange.samples import Samples, residual_of
from lensfit.exchange.text_file import Element, finite_number, read_xml
from lensfit.printable import printable

_KIND = "SynthEyes lens information"
_MOST_SAMPLES = 10_000
_FEWEST_SAMPLES = 3


@final
@dataclass(frozen=True, eq=False)
class RadialTable:
    """Distorted radii of true ones, about a centre; beyond the table it goes straight.

    Attributes
    ----------
    true_mm, distorted_radius_mm : Rising, from 0.
    """

    true_mm: Float[np.ndarray, " samples"]
    distorted_radius_mm: Float[np.ndarray, " samples"]
    centre_mm: tuple[float, float]

    def distorted(self, undistorted_mm: Points) -> Points:
        """The table, read by a cubic spline."""
        about = np.asarray(undistorted_mm, float) - np.array(self.centre_mm)
        radius = np.hypot(about[:, 0], about[:, 1])
        spline, last = self._spline, self.true_mm[-1]
        inside = np.minimum(radius, last)
        there = spline(inside) + spline(last, 1) * (radius - inside)
        near = spline(0.0, 1)
        scale = np.where(radius > 1e-9 * last, there / np.maximum(radius, 1e-300), near)
        return np.array(self.centre_mm) + about * scale[:, None]

    def undistorted(self, distorted_mm: Points) -> Points:
        """The inverse; NaN where there is none."""
        return inverse_points(self.distorted, distorted_mm, float(self.true_mm[-1]))

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(self.true_mm, self.distorted_radius_mm)


@dataclass(frozen=True)
class LniNotes:
    """What the table leaves out; None if not stated."""

    focal_length_mm: float | None = None
    principal_distance_mm: float | None = None
    centre_x_mm: float | None = None
    centre_y_mm: float | None = None
    sensor_width_mm: float | None = None
    width_px: float | None = None
    height_px: float | None = None
    focus_distance_mm: float | None = None


def syntheyes_text(
    table: RadialTable, name: str, notes: LniNotes, comments: tuple[str, ...]
) -> str:
    """The table in millimetres."""
    known = {k: v for k, v in vars(notes).items() if v is not None}
    rows = [
        f'<sample rin="{true:.9g}" rout="{distorted:.9g}"/>'
        for true, distorted in zip(
            table.true_mm, table.distorted_radius_mm, strict=True
        )
    ]
    lines = [
        f'<Lens title={quoteattr(name)} mm="1">',
        "<Info>",
        *(f"<note>{escape(comment)}</note>" for comment in comments),
        "</Info>",
        "<lensfit>",
        *(f"<{key}>{value!r}</{key}>" for key, value in known.items()),
        "</lensfit>",
        "<DATA>",
        *rows,
        "</DATA>",
        "</Lens>",
    ]
    return "\n".join(lines) + "\n"


def read_syntheyes(path: str | Path, stated: StatedValues) -> ForeignLens:
    """The lens of a table.

    Raises
    ------
    ExchangeError : It is no such file, its table is none, or nobody says how large
        picture and sensor are, or the focal length.
    """
    path = Path(path)
    root = read_xml(path, _KIND)
    if root.tag != "Lens":
        raise ExchangeError(f"begins with <{root.tag[:40]}>, not <Lens>", where=path)
    notes = _notes(root, path)
    size = stated.size_px
    if size is None and notes.width_px and notes.height_px:
        size = int(notes.width_px), int(notes.height_px)
    width = stated.sensor_width_mm or notes.sensor_width_mm
    focal = stated.focal_length_mm or notes.focal_length_mm
    for value, option in (
        (size, "--size"),
        (width, "--sensor-width-mm"),
        (focal, "--focal-length-mm"),
    ):
        if not value:
            raise ExchangeError(
                "is a table of radii, which knows no picture, sensor or focal length",
                where=path,
                remedy=f"give {option}",
            )
    assert size
    assert width
    assert focal
    sensor = (width, width * size[1] / size[0])
    centre = (notes.centre_x_mm or 0.0, notes.centre_y_mm or 0.0)
    is_mm = root.attributes.get("mm", "0").strip() not in ("", "0")
    table = _table(root, 1.0 if is_mm else sensor[1] / 2, centre, path)
    assumed = () if notes.principal_distance_mm else ("principal_distance_mm",)
    if notes.centre_x_mm is None:
        assumed += ("principal_point_mm",)
    state = ForeignState(
        map=table,
        principal_distance_mm=notes.principal_distance_mm or focal,
        principal_point_mm=centre,
        focal_length_mm=focal,
        focus_distance_mm=stated.focus_distance_mm or notes.focus_distance_mm,
        assumed=assumed,
    )
    name = root.attributes.get("title") or path.stem
    said = () if notes.centre_x_mm is not None else (
        "the table does not know the axis: the middle of the frame is taken",
    )  # fmt: skip
    return ForeignLens(_KIND, name, sensor, size, (state,), notes=said)


def _notes(root: Element, path: Path) -> LniNotes:
    found = {}
    for block in root.all("lensfit"):
        for key in LniNotes.__dataclass_fields__:
            text = block.text_of(key)
            if text is not None:
                found[key] = finite_number(text, key, path)
    notes = LniNotes(**found)
    lengths = {k: v for k, v in vars(notes).items() if v is not None}
    for key, value in lengths.items():
        if not key.startswith("centre") and not 0 < value < 1e9:
            raise ExchangeError(f"{key} = {value:g} cannot be", where=path)
    return notes


def _table(
    root: Element, unit_mm: float, centre: tuple[float, float], path: Path
) -> RadialTable:
    samples = [s for block in root.all("DATA") for s in block.all("sample")]
    if not _FEWEST_SAMPLES <= len(samples) <= _MOST_SAMPLES:
        raise ExchangeError(
            f"holds {len(samples)} samples, and {_FEWEST_SAMPLES} to {_MOST_SAMPLES} "
            "are read",
            where=path,
        )
    values = np.array(
        [
            [
                finite_number(s.attributes.get(key, ""), key, path)
                for key in ("rin", "rout")
            ]
            for s in samples
        ]
    )
    if values[0].any() or not (np.diff(values, axis=0) > 0).all():
        raise ExchangeError(
            "has a table whose radii do not rise from 0",
            where=path,
            remedy="sort its samples, and end it where the lens' picture ends",
        )
    if not math.isfinite(float(values.max()) * unit_mm):
        raise ExchangeError("has a table of no lens", where=path)
    return RadialTable(values[:, 0] * unit_mm, values[:, 1] * unit_mm, centre)


_SAMPLES = 64
_TERMS = 6
_BEYOND = 1.15


def fit_radial_table(samples: Samples, centre_mm: tuple[float, float]) -> RadialTable:
    """Distorted radii at even steps of the true one."""
    centre = np.array(centre_mm)
    out = samples.undistorted_mm - centre
    true = np.linalg.norm(out, axis=-1)
    along = out / np.maximum(true, 1e-300)[:, None]
    wanted = np.sum(along * (samples.distorted_mm - centre), -1)
    unit = float(true.max())
    powers = 2 * np.arange(_TERMS) + 1
    found, *_ = np.linalg.lstsq((true / unit)[:, None] ** powers, wanted)
    radius = np.linspace(0, _BEYOND, _SAMPLES)
    return RadialTable(radius * unit, radius[:, None] ** powers @ found, centre_mm)


def export_syntheyes(request: ExportRequest) -> Exported:
    """The table of one state, in millimetres."""
    lens, frame = request.lens(), request.frame
    fit, judge = samples_pair(lens, frame)
    x, y = principal_point(lens)
    made = fit_radial_table(fit, (x, y))
    residual = residual_of(made, judge)
    focus = lens.focus_distance_mm
    notes = LniNotes(
        focal_length_mm=lens.focal_length_mm,
        principal_distance_mm=float(lens.distortion.principal_distance_mm),
        centre_x_mm=x,
        centre_y_mm=y,
        sensor_width_mm=frame.sensor_width_mm,
        width_px=frame.size_px[0],
        height_px=frame.size_px[1],
        focus_distance_mm=None if focus is None or math.isinf(focus) else focus,
    )
    name = printable(" ".join(request.preset.lens.name.split()))
    comments = (lens_description(request, lens), f"residual {residual} over {frame}")
    write_text_atomic(request.out, syntheyes_text(made, name, notes, comments))
    found = export_result(request, lens, (Nearness("distortion", residual),))
    right, down = x / frame.pitch_mm, y / frame.pitch_mm
    centre = (
        "SynthEyes' table knows no centre: set that of the lens "
        f"{right:.2f} px right and {down:.2f} px down of the middle"
    )
    return Exported(found.paths, found.nearness, (*found.notes, centre))
