"""Draft a shoot file from photographs: values of their headers, and keys to fill in.

The draft is valid as it stands. Values from a header name the entry they came from;
what only the photographer knows is a comment that starts with TODO.

A cell of a camera report is text that a person typed: ``T2.8``, ``50mm``, ``4'11"``. A
stop with a T in front of it is a T-stop in whatever column it stands, and one with an f
is none. A bare number is a focal length in millimetres, but no distance: feet, metres
and millimetres are all usual, so its unit must be stated.
"""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from lensfit.atomic import write_text_atomic
from lensfit.chart.pattern import Pattern
from lensfit.errors import CameraError, OutputError, ShootError
from lensfit.io.camera.quantity import stop
from lensfit.io.camera.slates import Slate, slate_of
from lensfit.io.transfer import ENCODINGS
from lensfit.workflow.inspect import Inspection
from lensfit.workflow.shoot.crew_notation import KEY_OF_STOP, length_mm
from lensfit.workflow.shoot.resolve_take import free_name, target_of_pattern
from lensfit.workflow.shoot.toml_lines import toml_value

_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_TEXTS = ("lens_model", "lens_serial")


def slated_values(slate: Slate) -> Mapping[str, float | str]:
    """The quantities of a row, in the units of a shoot file.

    Raises
    ------
    ShootError : A cell holds no such quantity, or a distance without a unit; the line
        of the report is named.
    """
    values: dict[str, float | str] = {}
    for quantity, text in slate.values.items():
        if quantity in _TEXTS:
            values[quantity] = text
        elif quantity in ("f_number", "t_number"):
            try:
                kind, value = stop(text, quantity)
            except CameraError as error:
                remedy = "write T2.8, f/2.8 or 2.8"
                raise _wrong(slate, quantity, text, remedy) from error
            values[KEY_OF_STOP.get(kind or "", quantity)] = value
        elif quantity == "focal_length_mm" and _NUMBER.fullmatch(text):
            values[quantity] = float(text)
        elif _NUMBER.fullmatch(text):
            raise _wrong(slate, quantity, text, "say its unit: 4'11\", 1.5 m, 1500 mm")
        else:
            values[quantity] = length_mm(text, quantity, slate.place)
    return values


def _wrong(slate: Slate, quantity: str, text: str, remedy: str) -> ShootError:
    name = quantity.removesuffix("_mm").replace("_", " ")
    return ShootError(f"{text!r} is no {name}", where=slate.place, remedy=remedy)


_UNREAD = "grid"
_DISAGREEMENT = 0.02
_TARGET = """\
[[target]]
name = "grid"
kind = "dot-grid"           # TODO: dot-grid | line-grid | checkerboard | circle-grid
pitch_mm = 1.0              # TODO: distance of neighbouring marks, or [x, y]
# hole_diameter_mm = 0.5    # TODO: of a dot; line_width_mm for a line grid
"""
_UNKNOWN = {
    "focal_length_mm": "# focal_length_mm = 50.0         # TODO: as on the barrel",
    "f_number": "# f_number = 2.8                 # TODO: as on the barrel",
    "focus_distance_mm": (
        "# focus_distance_mm = 2000.0     # TODO: from the sensor, as on the barrel; "
        "inf is allowed"
    ),
}
_TARGET_DISTANCE = (
    "# target_distance_mm = 2000.0    # from the sensor; fitted when left out"
)


def write_draft_shoot(
    path: str | Path,
    inspections: Sequence[Inspection],
    slates: Sequence[Slate] = (),
) -> None:
    """Write a shoot file for these photographs; an existing file is never replaced.

    Parameters
    ----------
    slates : Rows of camera reports, which count before what headers say.

    Raises
    ------
    ShootError : There is no photograph, or a row of a report holds what it may not.
    OutputError : The file exists, or cannot be written.
    """
    path = Path(path)
    if not inspections:
        raise ShootError("no photograph to draft a shoot file from", where=path)
    if path.exists():
        raise OutputError(
            "exists and may have been edited",
            where=path,
            remedy="choose another name for the draft, or remove it first",
        )
    write_text_atomic(path, draft_shoot(inspections, path.parent, slates))


def draft_shoot(
    inspections: Sequence[Inspection], folder: Path, slates: Sequence[Slate] = ()
) -> str:
    """The text of a shoot file that lies in `folder`."""
    names = _chart_names(inspections)
    common = next(iter(names.values())) if len(names) == 1 else _UNREAD
    used = [names[i.chart] if i.chart else common for i in inspections]
    targets = [_target(pattern, name) for pattern, name in names.items()]
    if _UNREAD in used:
        targets.append(_TARGET)
    takes = [
        drafted_take(inspection, folder, name, slates)
        for inspection, name in zip(inspections, used, strict=True)
    ]
    return "\n".join([_lens(inspections), _camera(inspections), *targets, *takes])


def _chart_names(inspections: Sequence[Inspection]) -> dict[Pattern, str]:
    """A name for every chart that said what it is."""
    names: dict[Pattern, str] = {}
    for inspection in inspections:
        chart = inspection.chart
        if chart is not None and chart not in names:
            names[chart] = free_name(chart.kind, names.values())
    return names


def _target(pattern: Pattern, name: str) -> str:
    """A target as its chart's code states it."""
    said = msgspec.to_builtins(target_of_pattern(pattern, name))
    lines = ["[[target]]  # from the chart's code"]
    for key, value in said.items():
        if value is not None:
            listed = list(value) if isinstance(value, tuple) else value
            lines.append(f"{key} = {toml_value(listed)}")
    place = next(k for k, line in enumerate(lines) if line.startswith("pitch_mm"))
    lines[place] += "  # as printed at 100 %; TODO: measure the chart's ruler"
    return "\n".join(lines) + "\n"


def _lens(inspections: Sequence[Inspection]) -> str:
    lines = ["[lens]"]
    lines += _shared_value_lines(inspections, "lens_model", "name") or [
        'name = "unknown lens"       # TODO: as engraved'
    ]
    lines += _shared_value_lines(inspections, "lens_serial", "serial") or [
        '# serial = "1234567"        # TODO: as engraved; optional'
    ]
    return "\n".join(lines) + "\n"


def _camera(inspections: Sequence[Inspection]) -> str:
    lines = ["[camera]", *_shared_value_lines(inspections, "camera_model", "model")]
    lines += _shared_value_lines(inspections, "sensor_width_mm", "sensor_width_mm") or [
        "# sensor_width_mm = 24.89   # TODO: of the area that the photographs cover"
    ]
    widths = {inspection.state.sensor_width_mm for inspection in inspections}
    same_sensor = inspections if len(widths) == 1 else ()
    lines += _shared_value_lines(
        same_sensor, "sensor_height_mm", "sensor_height_mm"
    ) or ["# sensor_height_mm = 18.67  # left out, photosites are taken as square"]
    return "\n".join(lines + _mosaic(inspections)) + "\n"


def _mosaic(inspections: Sequence[Inspection]) -> list[str]:
    """The line for a mosaic that the noise shows; raw files need none."""
    if all(inspection.format == "raw" for inspection in inspections):
        return []
    seen = {one.mosaic: one.path.name for one in inspections if one.format != "raw"}
    known = [mosaic for mosaic in seen if mosaic is not None]
    if len(known) == 1 and None not in seen:
        return [_entry("mosaic", known[0], f"the noise of {seen[known[0]]}")]
    hint = (
        '# mosaic = "rggb"          # if colours were interpolated from one; optional'
    )
    return [hint, *(f"# {toml_value(m)} from the noise of {seen[m]}" for m in known)]


def _shared_value_lines(
    inspections: Sequence[Inspection], name: str, key: str
) -> list[str]:
    """The line for a value that all photographs share; a comment where they differ."""
    values: dict[object, str] = {}
    for inspection in inspections:
        value = getattr(inspection.state, name)
        if value is not None:
            source = inspection.state.sources[name]
            values.setdefault(value, f"{source} of {inspection.path.name}")
    if not values:
        return []
    first, *others = values.items()
    lines = [_entry(key, *first)]
    lines += [f"# TODO: but {toml_value(v)} from {source}" for v, source in others]
    return lines


def drafted_take(
    inspection: Inspection, folder: Path, target: str, slates: Sequence[Slate] = ()
) -> str:
    """The table of one photograph, for a shoot file that lies in `folder`."""
    image = Path(os.path.relpath(inspection.path, folder)).as_posix()
    lines = ["[[take]]", f"image = {toml_value(image)}", f'target = "{target}"']
    slate = slate_of(slates, inspection.path, inspection.exposed_at)
    slated = {} if slate is None else slated_values(slate)
    place = "" if slate is None else slate.place
    for name, unknown in _UNKNOWN.items():
        lines.append(_setting(inspection, name, unknown, slated, place))
    if "t_number" in slated:
        lines.append(_entry("t_number", slated["t_number"], place))
    said = slated.get("target_distance_mm")
    key = "target_distance_mm"
    lines.append(_TARGET_DISTANCE if said is None else _entry(key, said, place))
    if inspection.encoding != "linear":
        others = " | ".join(ENCODINGS)
        todo = "TODO: " if _may_be_linear(inspection) else ""
        lines.append(f'encoding = "{inspection.encoding}"  # {todo}assumed; {others}')
    return "\n".join(lines) + "\n"


def _setting(
    inspection: Inspection,
    name: str,
    unknown: str,
    slated: Mapping[str, float | str],
    place: str,
) -> str:
    """A setting by the report, else by the header, else to be filled in."""
    header = getattr(inspection.state, name)
    said = slated.get(name)
    if said is None:
        if header is None:
            # A T-stop of the report stands for the f-number, and is written itself.
            stands = name == "f_number" and "t_number" in slated
            return "# f_number = 2.8                 # optional" if stands else unknown
        return _entry(name, header, inspection.state.sources[name])
    line = _entry(name, said, place)
    if header is not None and not _alike(float(said), float(header)):
        line += f"; TODO: {toml_value(header)} in {inspection.state.sources[name]}"
    return line


def _alike(one: float, other: float) -> bool:
    return one == other or abs(one - other) <= _DISAGREEMENT * max(one, other)


def _may_be_linear(inspection: Inspection) -> bool:
    """Whether such a file holds linear samples as often as others."""
    deep_png = inspection.format == "png" and inspection.bit_depth == 16
    return inspection.encoding == "srgb" and (inspection.format == "tiff" or deep_png)


def _entry(key: str, value: object, source: str) -> str:
    return f"{key} = {toml_value(value)}  # from {_comment(source)}"


def _comment(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
