"""`lensfit overscan`: what the CG department must render beyond the frame."""

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._options import size_px
from lensfit.cli._terminal import say_line
from lensfit.cli.apply import FilterName
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.camera import PixelGroup, ScaleToSensorOption
from lensfit.cli.groups.knobs import AberrationGroup, BokehGroup, stated_knobs
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup
from lensfit.cli.groups.rendering import DisableGroup


@takes_groups
def overscan(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    *,
    library: LibraryGroup,
    size: Annotated[
        str | None,
        typer.Option(help="Frame, as 4096x3072; that of the photographs by default"),
    ] = None,
    plate: Annotated[
        Path | None,
        typer.Option(
            help="Take frame and camera from this EXR, and say if it has enough"
        ),
    ] = None,
    focal_length_mm: Annotated[
        str | None,
        typer.Option(
            help="Of the lens, mm, or a range: 24:70; all that was measured if left out"
        ),
    ] = None,
    focus_distance_mm: Annotated[
        str | None,
        typer.Option(
            help="From the sensor, mm, or a range: 800:inf; all that was measured"
        ),
    ] = None,
    f_number: Annotated[
        float | None, typer.Option(help="Also say what depth of field needs")
    ] = None,
    nearest_mm: Annotated[
        float | None,
        typer.Option(
            help="Nearest object from the sensor, mm; beyond focus only if left out"
        ),
    ] = None,
    sensor_width_mm: Annotated[
        float | None, typer.Option(help="Width that the frame spans on the sensor, mm")
    ] = None,
    pixels: PixelGroup,
    scale_to_sensor: ScaleToSensorOption = False,
    filter_name: Annotated[
        FilterName,
        typer.Option(
            "--filter", help="Of the warp; keys-6 reads a pixel further, sinc-16 six"
        ),
    ] = FilterName.cubic,
    aberrations: AberrationGroup,
    disabled: DisableGroup,
    bokeh: BokehGroup,
    per_channel: Annotated[
        bool,
        typer.Option(
            "--per-channel", help="Also say what red, green and blue need alone"
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print how much more than the frame the CG must render, to the pixel.

    In pixels on each side, in percent as lens/overscan states it, as render resolution,
    data window and wider film back, and as the factor of OpenLensIO. Over a range of
    focal lengths or focus distances it is the largest.

    --plate takes all of this from a rendered plate and checks its overscan. Knobs
    count as in apply: they change the distortion and the width of the blur.

    Example: lensfit overscan takumar/preset.json --size 4096x3072 --f-number 2
    """
    from lensfit.plate.camera.sources import StateOverrides
    from lensfit.preset.knobs import adjusted_knobs
    from lensfit.workflow.overscan import (
        OverscanQuestion,
        overscan_of_plate,
        plan_overscan,
    )

    frame = size_px(size)
    focal = _span(focal_length_mm, "--focal-length-mm")
    focus = _span(focus_distance_mm, "--focus-distance-mm")
    loaded = library.find(preset).preset
    knobs = stated_knobs(aberrations, bokeh) | disabled.gains
    camera = loaded.camera
    if plate is None:
        own = None
        size_of_all = camera.image_width_px, camera.image_height_px
        known = OverscanQuestion(size_of_all, knobs=adjusted_knobs(loaded.knobs, knobs))
    else:
        overrides = StateOverrides(
            focal and focal[0], f_number, focus and focus[0], sensor_width_mm
        )
        own = overscan_of_plate(
            loaded, plate, overrides, knobs, scale_to_sensor=scale_to_sensor
        )
        known = own.question
    question = OverscanQuestion(
        frame or known.size_px,
        known.sensor_width_mm if sensor_width_mm is None else sensor_width_mm,
        focal or known.focal_length_mm,
        focus or known.focus_distance_mm,
        known.f_number if f_number is None else f_number,
        nearest_mm,
        filter_name.value,
        known.knobs,
        known.pixel_aspect if pixels.pixel_aspect is None else pixels.pixel_aspect,
        scale_to_sensor,
    )
    plan = plan_overscan(loaded, question)
    _say(own, plan, per_channel, as_json)


def _say(own, plan, per_channel: bool, as_json: bool) -> None:
    from lensfit.cli._door import say_note

    for note in dict.fromkeys([*(own.notes if own else ()), *plan.notes]):
        say_note(note)
    if plan.margins.missing:
        say_note("part of the frame shows nothing that an undistorted plate can hold")
    if as_json:
        facts = _facts(plan, per_channel) | (_plate_record(own, plan) if own else {})
        typer.echo(json.dumps(facts, indent=1))
        return
    for line in [*_lines(plan, per_channel), *(_verdict(own, plan) if own else [])]:
        say_line(line)


def _span(text: str | None, option: str) -> tuple[float, float] | None:
    """A number, or two with a colon between, rising."""
    if text is None:
        return None
    try:
        low, high = (float(part) for part in (text.split(":") * 2)[:2])
    except ValueError:
        low = high = math.nan
    if text.count(":") > 1 or not 0 < low <= high:
        raise typer.BadParameter(
            f"{text!r} is neither a length nor a range; write 35 or 24:70",
            param_hint=option,
        )
    return low, high


def _facts(plan, per_channel: bool) -> dict:
    found = {
        **_need(plan.margins, plan.camera),
        "open_lens_io_factor": plan.factor,
        "states": plan.states,
    }
    if plan.blur_camera is not None:
        found["depth_of_field"] = {
            "blur_radius_px": plan.blur_px,
            **_need(plan.with_blur, plan.blur_camera),
        }
    if per_channel:
        found["channels"] = {c: m._asdict() for c, m in plan.channels.items()}
    return found


def _plate_record(own, plan) -> dict:
    blurred = plan.with_blur
    return {
        "plate": {
            "margins_px": own.margins._asdict(),
            "stated_percent": own.stated_percent,
            "suffices": own.suffices(plan.margins),
            "suffices_with_depth_of_field": blurred and own.suffices(blurred),
        }
    }


def _verdict(own, plan) -> list[str]:
    stated = own.stated_percent
    said = "" if stated is None else f", header states {stated:g} %"
    enough = "enough" if own.suffices(plan.margins) else "too little"
    if plan.with_blur is not None and own.suffices(plan.margins):
        word = "enough" if own.suffices(plan.with_blur) else "too little"
        enough += f"; with depth of field {word}"
    ends = [side for side, empty in zip(_SIDES, own.empty, strict=True) if empty]
    if ends:
        said += f"; empty, as it ends inside the frame, on the {', '.join(ends)}"
    return [f"The plate has {_sides(own.margins)}{said}: {enough}"]


_SIDES = ("left", "top", "right", "bottom")


def _need(margins, camera) -> dict:
    return {
        "margins_px": margins._asdict(),
        "overscan_percent": camera.percent,
        "render_px": list(camera.render_px),
        "data_window": list(camera.data_window),
        "sensor_mm": list(camera.sensor_mm),
    }


def _lines(plan, per_channel: bool) -> list[str]:
    lines = [
        *_margin_lines(plan.margins, plan.camera),
        f"OpenLensIO overscan {plan.factor:.6f}",
    ]
    if per_channel:
        lines += [f"{c} alone: {_sides(m)}" for c, m in plan.channels.items()]
    if plan.blur_camera is not None:
        lines.append(
            f"With depth of field, blur of up to {plan.blur_px:.1f} px radius:"
        )
        lines += [
            f"  {line}" for line in _margin_lines(plan.with_blur, plan.blur_camera)
        ]
    if plan.states > 1:
        lines.append(f"The largest of {plan.states} states of the lens")
    return lines


def _margin_lines(margins, camera) -> list[str]:
    width, height = camera.render_px
    window = camera.data_window
    return [
        f"pixels beyond the frame: {_sides(margins)}",
        f"lens/overscan {camera.percent:.4f} % (in total, one for both axes: "
        "some sides hold more)",
        f"render {width} x {height}, data window "
        f"({window.x_min}, {window.y_min}) - ({window.x_max}, {window.y_max})",
        f"film back {camera.sensor_mm[0]:.6f} x {camera.sensor_mm[1]:.6f} mm, "
        "focal length unchanged",
    ]


def _sides(margins) -> str:
    return (
        f"left {margins.left}, top {margins.top}, "
        f"right {margins.right}, bottom {margins.bottom}"
    )
