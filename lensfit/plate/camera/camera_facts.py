"""A picture's camera and knobs with their sources, as `lensfit inspect` shows them.

Every value with its source and with those that it overrides, faults of the header, and,
if a preset is named, the values that would be taken from it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from lensfit.errors import LensfitError
from lensfit.io.camera.header_entries import unmapped_entries
from lensfit.io.metadata import CameraState
from lensfit.plate.camera.plate_camera import (
    AdjustedKnobs,
    KnobWord,
    PlateCamera,
    SourcedValue,
    knobs_of_plate,
)
from lensfit.plate.camera.sources import CameraSources
from lensfit.plate.notes import FrameNote
from lensfit.preset.knobs import NEUTRAL, misspelt_knob_notes

if TYPE_CHECKING:
    from lensfit.plate.camera.plate_state import AssumedValue
    from lensfit.preset.schema import Preset

_UNMAPPED = "[aliases] of lensfit.toml maps it"
Rows = list[tuple[str, str, str]]


@dataclass(frozen=True)
class CameraFacts:
    """All sources' words.

    Attributes
    ----------
    state : The camera state, with its sources.
    overruled : By quantity, what other sources and entries say, the next best first.
    undecided : What only a preset can turn into a camera state: a field of view
        without a sensor height, a focus distance from the pinhole.
    problems : What is wrong and would count, one sentence each.
    passed_over : By quantity, header entries that are wrong and do not count.
    knobs : As far as a source states them.
    assumed : What would be taken from the preset.
    notes : What was assumed, and what contradicts itself.
    unmapped : Header entries that look like a camera's and that nothing reads.
    """

    state: CameraState
    overruled: Mapping[str, tuple[SourcedValue, ...]]
    undecided: Mapping[str, SourcedValue]
    problems: tuple[str, ...]
    passed_over: Mapping[str, tuple[str, ...]]
    knobs: AdjustedKnobs = field(default_factory=AdjustedKnobs)
    assumed: tuple["AssumedValue", ...] = ()
    notes: tuple[str, ...] = ()
    unmapped: Mapping[str, str] = field(default_factory=dict)


def camera_facts(
    path: Path,
    header: Mapping[str, object],
    size_px: tuple[int, int],
    sources: CameraSources,
    preset: "Preset | None" = None,
) -> CameraFacts:
    """The facts about one picture.

    Parameters
    ----------
    path, header, size_px : Of the picture.
    sources : Where its camera is described.
    preset : The lens that it would be rendered with.

    Raises
    ------
    LensfitError : A sidecar or settings file is malformed, or lacks the picture.
    """
    width_mm = None if preset is None else preset.camera.sensor_width_mm
    camera = sources.described(path, header, size_px, width_mm)
    knobs = knobs_of_plate(
        NEUTRAL if preset is None else preset.knobs, header, camera.settings, {}
    )
    bad = [entry for entries in camera.bad.values() for entry in entries]
    problems = [str(entry.error) for entry in bad if entry.counts]
    problems += [str(error) for error in knobs.problems]
    notes: list[str] = [*camera.notes, *misspelt_knob_notes(header)]
    notes += [
        FrameNote(f"{path.name}: {said}", f"contradiction {name}")
        for name, said in knobs.notes
    ]
    taken: tuple[AssumedValue, ...] = ()
    if preset is not None and not problems:
        from lensfit.plate.camera.plate_state import plate_state

        try:
            state = plate_state(preset, camera, header)
            camera, taken, notes = state.camera, state.assumed, [*state.notes]
        except LensfitError as error:
            problems.append(str(error).removeprefix(f"{path}: "))
    decided = camera.state.known()
    return CameraFacts(
        camera.state,
        camera.overruled,
        {name: known for name, known in camera.known.items() if name not in decided},
        tuple(problems),
        _passed_over(camera),
        knobs,
        taken,
        tuple(notes),
        unmapped_entries(header, camera.settings.aliases),
    )


def camera_rows(facts: CameraFacts) -> Rows:
    """Lines of a table: what, its value, and where from."""
    rows: Rows = []
    stated = facts.state.known()
    for name, value in stated.items():
        rows.append((name, _value_text(value), facts.state.sources[name]))
        rows += _beside(name, facts)
    for name, known in facts.undecided.items():
        from_pinhole = " from the pinhole" * known.from_pupil
        rows.append((name, f"{known.value:g}{from_pinhole}", known.source))
        rows += _beside(name, facts)
    for name in facts.overruled:
        if name not in stated and name not in facts.undecided:
            rows += [(name, "unknown", "see problem"), *_beside(name, facts)]
    rows += [(one.name, _value_text(one.value), one.whose) for one in facts.assumed]
    for name, word in facts.knobs.known.items():
        rows.append((f"knob {name}", _value_text(word.value), word.source))
        rows += _overruled_rows(facts.knobs.overruled.get(name, ()))
    rows += [("not read", f"{k} {v}", _UNMAPPED) for k, v in facts.unmapped.items()]
    return rows + [("problem", problem, "") for problem in facts.problems]


def camera_record(facts: CameraFacts) -> dict[str, object]:
    """The facts in types that JSON knows; an infinite distance is the text "inf"."""
    state = facts.state.known() | {"sources": dict(facts.state.sources)}
    others = {**facts.overruled, **facts.knobs.overruled}
    return {
        "state": {k: "inf" if v == math.inf else v for k, v in state.items()},
        "overruled": {n: [_record(k) for k in known] for n, known in others.items()},
        "undecided": {name: _record(known) for name, known in facts.undecided.items()},
        "assumed": {
            one.name: {"value": one.value, "source": one.whose} for one in facts.assumed
        },
        "knobs": {name: word._asdict() for name, word in facts.knobs.known.items()},
        "problems": list(facts.problems),
        "passed_over": {name: list(said) for name, said in facts.passed_over.items()},
        "notes": list(facts.notes),
        "not_read": dict(facts.unmapped),
    }


def _passed_over(camera: PlateCamera) -> dict[str, tuple[str, ...]]:
    found = {
        name: tuple(entry.error.what for entry in entries if not entry.counts)
        for name, entries in camera.bad.items()
    }
    return {name: said for name, said in found.items() if said}


def _beside(name: str, facts: CameraFacts) -> Rows:
    """What else was said of a quantity."""
    wrong = facts.passed_over.get(name, ())
    others = _overruled_rows(facts.overruled.get(name, ()))
    return others + [("", what, "passed over") for what in wrong]


def _overruled_rows(others: tuple[SourcedValue | KnobWord, ...]) -> Rows:
    return [("", _value_text(k.value), f"overruled: {k.source}") for k in others]


def _value_text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _record(known: SourcedValue | KnobWord) -> dict[str, object]:
    value = "inf" if known.value == math.inf else known.value
    record: dict[str, object] = {"value": value, "source": known.source}
    if isinstance(known, SourcedValue):
        record |= {"from": "pinhole"} if known.from_pupil else {}
        record |= {"of": "pinhole"} if known.of_pinhole else {}
    return record
