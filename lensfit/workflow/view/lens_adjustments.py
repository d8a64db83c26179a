"""The adjustments that a page makes to a lens, their equivalents, and saving them.

An adjusted lens is an `ApplyOptions`: those that the command was started with, with
some quantities of the camera and some knobs replaced. The equivalent command line is
one of `lensfit apply`, so that the same picture can be rendered without the page.

The controls of the page follow from the definitions of the knobs: a knob added to
`lensfit.preset.knobs` appears in the page by itself, with the limits, the text and the
group that it has there.

Adjustments are saved to a shot's settings file, or as an edit of a lens of the library.
The rest of a settings file is not changed; one that is written in a way that
`lensfit.workflow.shoot.toml_lines` does not understand is left alone. An edit has knobs
alone, with who, when and why.
"""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta, Struct

from lensfit.atomic import write_text_atomic
from lensfit.errors import PresetError, SettingsError
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_camera import option_of
from lensfit.plate.camera.settings import load_settings
from lensfit.preset.knobs import GROUP_OF, NEUTRAL, Knobs, adjusted_knobs
from lensfit.preset.library.edit import Author, RequestedEdit, edit_preset
from lensfit.preset.schema import Preset
from lensfit.workflow.shoot.toml_lines import with_keys

CAMERA = ("focal_length_mm", "f_number", "focus_distance_mm")
_Positive = Annotated[float, Meta(gt=0, le=1e9)]
Distance = _Positive | Literal["inf"]
FILES = tuple(name for name in GROUP_OF if name.endswith("_image"))
"""Knobs that name files, which no page may."""


class LensAdjustments(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Adjustments; what is left out stays as the plate and the preset have it.

    Attributes
    ----------
    frame : Place of the plate among those of the sequence, from 0.
    focus_distance_mm : From the sensor.
    knobs : By name.
    defocus : Whether depth of field is rendered; as the command has it if None.
    """

    frame: Annotated[int, Meta(ge=0, le=10**7)] = 0
    focal_length_mm: _Positive | None = None
    f_number: _Positive | None = None
    focus_distance_mm: Distance | None = None
    knobs: Annotated[dict[str, int | float], Meta(max_length=200)] = {}
    defocus: bool | None = None

    @property
    def camera(self) -> dict[str, float]:
        """Adjusted quantities of the camera, by name."""
        values = {name: getattr(self, name) for name in CAMERA}
        return {name: float(v) for name, v in values.items() if v is not None}


def adjustments_of_options(options: ApplyOptions) -> LensAdjustments:
    """What options of `apply` state of the camera and of knobs."""
    stated = {name: getattr(options.overrides, name) for name in CAMERA}
    knobs = {n: v for n, v in options.knobs.items() if isinstance(v, int | float)}
    return LensAdjustments(**stated, knobs=knobs)


def require_valid_adjustments(
    preset: Preset, wanted: LensAdjustments
) -> LensAdjustments:
    """The same, if every knob is one and has a value that it can have.

    Raises
    ------
    SettingsError : There is no such knob, it names a file, or it cannot be set to that.
    """
    for name, value in wanted.knobs.items():
        if name in FILES:
            raise SettingsError(
                f"{name} names a file, which a page may not",
                remedy=f"state {option_of(name)} when you start the view",
            )
        # Not isfinite: a whole number may be beyond any float.
        if not abs(value) <= sys.float_info.max:
            raise SettingsError(f"{name} is no finite number")
    adjusted_knobs(preset.knobs, wanted.knobs, error=SettingsError, where="knobs")
    return wanted


def adjusted_options(base: ApplyOptions, wanted: LensAdjustments) -> ApplyOptions:
    """The options of `apply` that render the adjusted lens.

    Parameters
    ----------
    base : What the command was started with.
    """
    camera = wanted.camera
    found = replace(
        base,
        overrides=replace(base.overrides, **camera),
        knobs={**base.knobs, **wanted.knobs},
    )
    if "focus_distance_mm" in camera:
        found = replace(found, camera=replace(base.camera, focus_at=None))
    if wanted.defocus is not None:
        switches = replace(found.switches, defocus=wanted.defocus)
        found = replace(found, switches=switches)
    return found


_NO_DEFOCUS = "--no-defocus"


class StartCommand(Struct, frozen=True):
    """The words that the command was started with.

    Attributes
    ----------
    preset, plates : As they were given.
    options : Each option of `apply` with its values.
    """

    preset: str
    plates: str
    options: tuple[tuple[str, ...], ...] = ()


def command_line(started: StartCommand, wanted: LensAdjustments) -> str:
    """The command that renders the adjusted lens, for a shell."""
    values: Mapping[str, float] = wanted.camera | wanted.knobs
    stated = {option_of(name): number_text(value) for name, value in values.items()}
    dropped = {*stated} | ({"--focus-at"} if wanted.focus_distance_mm else set())
    if wanted.defocus is not None:
        dropped.add(_NO_DEFOCUS)
    words: list[str] = ["lensfit", "apply", started.preset, started.plates]
    words += ["--out", "lens"]
    for option in started.options:
        if option[0] not in dropped:
            words += _joined_option(option)
    for word, value in stated.items():
        words += _joined_option((word, value))
    if wanted.defocus is False:
        words.append(_NO_DEFOCUS)
    return shlex.join(words)


def _joined_option(option: Sequence[str]) -> list[str]:
    """A negative number would read as an option of its own."""
    word, *values = option
    return [f"{word}={values[0]}"] if len(values) == 1 else [word, *values]


def whole_if_it_is(value: float) -> float:
    """A number without a point where it needs none."""
    return int(value) if float(value).is_integer() else float(value)


def number_text(value: float) -> str:
    """A number as options and settings files take it: whole without a point, or inf."""
    return repr(whole_if_it_is(value))


def settings_tables(wanted: LensAdjustments) -> dict[str, dict[str, float]]:
    """The adjustments as tables of a settings file."""
    tables = {"camera": wanted.camera, "knobs": dict(wanted.knobs)}
    return {name: table for name, table in tables.items() if table}


_TITLES = {"aberration": "Aberrations", "bokeh": "Bokeh", "look": "Look"}
_NAMED = {
    "f_number": "f-number",
    "t_number": "T-number",
    "roi": "Where to look: [x0, y0, x1, y1] (px)",
    "asymmetric": "Every other row shifted (true or false)",
    "squares": "Squares: [columns, rows]",
    "marks": "Marks: [columns, rows]",
    "dictionary": "ArUco dictionary",
    "marker_ratio": "Marker side / square side",
    "encoding": "Encoding of light",
}
"""Quantities that their key does not name plainly."""
_UNITS = {
    "mm": "mm", "um": "µm", "percent": "%", "deg": "°", "kelvin": "K", "stops": "stops",
}  # fmt: skip
_WIDEST = 30_000.0
"""Range beyond which a slider says nothing, and a number is typed."""
_USUAL_GAIN = (-1.0, 3.0)
"""Gains may be a hundred; a slider that long could not be set."""


def knob_controls() -> list[dict[str, Any]]:
    """Groups of knobs, each with its name and its knobs.

    Of a knob: its name, a label, what it does, least and most value, the neutral one
    (None: as measured), whether it counts (whole numbers), and the ends of a slider,
    which has none where a number must be typed.
    """
    schema = msgspec.json.schema(Knobs)["$defs"]
    groups = []
    for group in Knobs.__struct_fields__:
        record = type(getattr(NEUTRAL, group)).__name__
        properties = schema[record]["properties"]
        knobs = [
            _control(name, properties[name])
            for name in properties
            if GROUP_OF[name] == group and name not in FILES
        ]
        groups.append({"name": _TITLES.get(group, group.title()), "knobs": knobs})
    return groups


def _control(name: str, schema: dict[str, Any]) -> dict[str, Any]:
    choices = schema.get("anyOf", [schema])
    number = next(one for one in choices if one["type"] in ("number", "integer"))
    least, most = number.get("minimum"), number.get("maximum")
    neutral = schema.get("default")
    return {
        "name": name,
        "label": label_of(name),
        "text": number.get("description") or schema.get("description") or "",
        "least": least,
        "most": most,
        "neutral": neutral,
        "whole": number["type"] == "integer",
        "slider": _slider(name, neutral, least, most),
    }


def label_of(name: str) -> str:
    """A quantity as people call it, with its unit."""
    if name in _NAMED:
        return _NAMED[name]
    *words, last = name.split("_")
    if words and last in _UNITS:
        return f"{' '.join(words).capitalize()} ({_UNITS[last]})"
    return " ".join((*words, last)).capitalize()


def _slider(
    name: str, neutral: Any, least: float | None, most: float | None
) -> tuple[float, float] | None:
    if neutral is None or least is None or most is None or most - least > _WIDEST:
        return None
    if name.endswith("_gain") and most > _USUAL_GAIN[1]:
        return max(least, _USUAL_GAIN[0]), _USUAL_GAIN[1]
    return least, most


Tables = Mapping[str, Mapping[str, float]]


class SavedSettings(NamedTuple):
    """What became of a settings file.

    Attributes
    ----------
    changed : Whether it is another one now.
    notes : What is said where it does not suffice.
    """

    changed: bool
    notes: list[str]


def save_settings(path: Path, changes: Tables) -> bool:
    """Set keys of a settings file, which is made if it is not there; whole or not.

    False where it says so already, and stays untouched.

    Parameters
    ----------
    changes : Table, key and value.

    Raises
    ------
    SettingsError : The file is malformed, or is written so that its keys cannot be set.
    OutputError : It cannot be written.
    """
    old = ""
    if path.is_file():
        load_settings(path)  # what is malformed is refused in its own words
        old = path.read_text(encoding="utf-8")
    new = changed_text(old, changes, path)
    if new == old:
        return False
    write_text_atomic(path, new)
    return True


def changed_text(old: str, changes: Tables, path: Path) -> str:
    """The text of a settings file with other values.

    Raises
    ------
    SettingsError : Its keys cannot be set line by line.
    """
    text = old
    for table, values in changes.items():
        plain = {key: whole_if_it_is(value) for key, value in values.items()}
        changed = with_keys(text, table, plain)
        if changed is None:
            lines = "; ".join(
                f"{k} = {number_text(v)}"
                for t in changes.values()
                for k, v in t.items()
            )
            raise SettingsError(
                "is written so that its keys cannot be set one by one",
                where=path,
                remedy=f"set them by hand: {lines}",
            )
        text = changed
    return text


class LibraryLens(NamedTuple):
    """A lens as the library knows it.

    Attributes
    ----------
    name : Without its version: an edit is made to the one in use.
    library : The level that is edited; the user's own if None.
    """

    name: str
    library: Path | None


def save_edit(
    shelved: LibraryLens | None, wanted: LensAdjustments, author: Author
) -> str:
    """The full name of the version that the knobs are saved as.

    Parameters
    ----------
    shelved : None for a preset outside a library.

    Raises
    ------
    PresetError : It is in no library, no knob is adjusted, or the edit cannot be made.
    OutputError : The level cannot be written.
    """
    if shelved is None:
        raise PresetError(
            "the preset is a file outside a library, where nothing is on record",
            remedy='put it there with "lensfit preset save", and view it by its name',
        )
    wishes = [
        RequestedEdit(name, whole_if_it_is(v)) for name, v in wanted.knobs.items()
    ]
    if not wishes:
        raise PresetError(
            "no knob is adjusted; f-number and focus are of the shot, not of the lens",
            remedy="save these to the shot",
        )
    return edit_preset(shelved.name, wishes, author, library=shelved.library).full_name
