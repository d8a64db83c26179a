"""Knobs on the command line: an option for each, made from where it is defined."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Annotated, Any, TypeVar, get_args, get_origin

import msgspec
import typer

from lensfit.preset.aberration_knobs import AberrationKnobs
from lensfit.preset.bokeh_knobs import BokehKnobs
from lensfit.preset.look_knobs import LookKnobs

Group = TypeVar("Group")


def stated(*groups: Any) -> dict[str, object]:
    """Name and value of every knob that was given."""
    values = {f.name: getattr(group, f.name) for group in groups for f in fields(group)}
    return {name: value for name, value in values.items() if value is not None}


def _options_of(
    struct: type[msgspec.Struct], panel: str
) -> Callable[[type[Group]], type[Group]]:
    """Gives a group an option for every knob; None is what nobody stated."""

    def filled(group: type[Group]) -> type[Group]:
        knobs = msgspec.structs.fields(struct)
        group.__annotations__ = {k.name: _option(k, panel) for k in knobs}
        for knob in knobs:
            setattr(group, knob.name, None)
        return dataclass(frozen=True)(group)

    return filled


def _option(knob: msgspec.structs.FieldInfo, panel: str) -> Any:
    kind, meta = _kind(knob.type)
    bounds: Any = {} if kind is str else {"min": meta.ge, "max": meta.le}
    option = typer.Option(help=meta.description, rich_help_panel=panel, **bounds)
    return Annotated[kind | None, option]


def _kind(annotation: Any) -> tuple[Any, msgspec.Meta]:
    """The type of a knob, and what its annotations say of it together."""
    found = msgspec.Meta()
    while (arguments := get_args(annotation)) and annotation is not None:
        if get_origin(annotation) is Annotated:
            found = _joined(found, arguments[1:])
        annotation = next(a for a in arguments if a is not type(None))
    return annotation, found


def _joined(found: msgspec.Meta, more: tuple[Any, ...]) -> msgspec.Meta:
    for meta in more:
        found = msgspec.Meta(
            ge=meta.ge if found.ge is None else found.ge,
            le=meta.le if found.le is None else found.le,
            description=found.description or meta.description,
        )
    return found


@_options_of(AberrationKnobs, "Aberrations")
class AberrationGroup:
    """How much of each aberration that was measured."""


@_options_of(BokehKnobs, "Bokeh")
class BokehGroup:
    """The opening, and what it makes of lights."""


@_options_of(LookKnobs, "Look")
class LookGroup:
    """What no grid shows."""
