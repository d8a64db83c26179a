"""Every knob arrives by preset, header, settings and option alike, and by itself."""

import math
import types
import typing

import msgspec
import pytest
from plate_makers import CAMERA, SENSOR, make_preset, sharp, write_plate

from lensfit.io.exr import read_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.preset.knobs import GROUP_OF, NEUTRAL, active_knobs, adjusted_knobs
from lensfit.workflow.apply import apply
from lensfit.workflow.plan_plate import plan_plate

KNOBS = {
    field.name: field
    for group in msgspec.structs.fields(NEUTRAL)
    for field in msgspec.structs.fields(getattr(NEUTRAL, group.name))
}


def other_than_neutral(name: str) -> float | int | str:
    """A value within the knob's limits that is not the neutral one."""
    annotation, neutral = KNOBS[name].type, KNOBS[name].default
    while typing.get_origin(annotation) in (types.UnionType, typing.Union):
        inner = [a for a in typing.get_args(annotation) if a is not type(None)]
        annotation = inner[0]
    kind, *metas = typing.get_args(annotation) or (annotation,)
    if kind is str:
        return "bokeh.png"
    low = next(m.ge for m in metas if m.ge is not None)
    high = next(m.le for m in metas if m.le is not None)
    start = neutral if neutral is not None else low
    value = start + 0.25 * (high - start) if start < high else (low + high) / 2
    return math.ceil(value) if kind is int else value


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    return write_plate(tmp_path_factory.mktemp("plate") / "plate.0001.exr")


@pytest.mark.parametrize("name", sorted(GROUP_OF))
def test_a_knob_arrives_from_everywhere_and_alone(name, plate, tmp_path):
    value = other_than_neutral(name)
    preset = make_preset()
    by_preset = msgspec.structs.replace(
        preset, knobs=adjusted_knobs(NEUTRAL, {name: value})
    )
    folder = tmp_path / "shot"
    folder.mkdir()
    stated = f'"{value}"' if isinstance(value, str) else value
    (folder / "lensfit.toml").write_text(f"[knobs]\n{name} = {stated}\n")
    in_settings = write_plate(folder / "plate.0001.exr")
    header = {**CAMERA, **SENSOR, f"lensfit/{name}": str(value)}
    in_header = write_plate(tmp_path / "plate.0001.exr", header)
    states = [
        PlateLens(lens, ApplyOptions(knobs=knobs)).state_of(read_exr(path), path)
        for lens, knobs, path in (
            (by_preset, {}, plate),
            (preset, {name: value}, plate),
            (preset, {}, in_header),
            (preset, {}, in_settings),
        )
    ]
    lenses = [PlateLens(preset, ApplyOptions()).signature(state) for state in states]
    for state, said in zip(states, lenses, strict=True):
        assert active_knobs(state.knobs) == {name: pytest.approx(value)}
        assert name in said
    assert len(set(lenses)) == 1


def test_all_knobs_stated_as_neutral_change_no_bit(plate, tmp_path):
    neutral = {name: field.default for name, field in KNOBS.items()}
    frames = []
    for folder, knobs in (("plain", {}), ("neutral", neutral)):
        done = apply(
            make_preset(), plate, tmp_path / folder, options=sharp(knobs=knobs)
        )
        assert not done.failures
        frames.append(done.written[0].read_bytes())
    assert frames[0] == frames[1]


def test_a_knob_that_turns_nothing_is_told_once_by_apply_and_by_plan(tmp_path):
    for number in (1, 2):
        write_plate(tmp_path / f"plate.{number:04d}.exr")
    options = sharp(knobs={"coma_gain": 2.0, "lateral_red_gain": 2.0})
    plates = tmp_path / "plate.####.exr"
    done = apply(make_preset(), plates, tmp_path / "out", options=options)
    _, planned = plan_plate(make_preset(), tmp_path / "plate.0001.exr", options)
    for notes in (done.notes, planned):
        (told,) = [note for note in notes if "has no effect" in note]
        assert told.startswith("coma_gain has no effect: the preset has no coma")
        assert "--coma-um" in told
    assert not done.failures
