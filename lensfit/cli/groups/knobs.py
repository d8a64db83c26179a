"""Knobs on the command line: an option for each, made from where it is defined."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Annotated, Any, TypeVar, get_args, get_origin

import msgspec
import typer

from lensfit.preset.knob_groups import AberrationKnobs, BokehKnobs, LookKnobs

Group = TypeVar("Group")


def stated_knobs(*groups: Any) -> dict[str, object]:
    """Name and value of every knob that was given."""
    values = {f.name: getattr(group, f.name) for group in groups for f in fields(group)}
    return {name: value for name, value in values.items() if value is not None}


def _options_of(
    struct: type[msgspec.Struct], panel: str
) -> Callable[[type[Group]], type[Group]]:
    """Gives a group an option for every knob; None is what nobody stated."""

    def filled(group: type[Group]) -> type[Group]:
        knobs = msgspec.structs.fields(struct)
        group.__annotations__ = {k.name: _option(struct, k, panel) for k in knobs}
        for knob in knobs:
            setattr(group, knob.name, None)
        return dataclass(frozen=True)(group)

    return filled


def _option(
    struct: type[msgspec.Struct], knob: msgspec.structs.FieldInfo, panel: str
) -> Any:
    """Its limits stand in the help's text: beside the types of numbers they would take
    so much of a line that names were cut."""
    kind, meta = _kind(knob.type)
    text, more = meta.description or "", {}
    if meta.ge is not None and meta.le is not None:
        text += f" ({meta.ge:g} to {meta.le:g})"
        number = _parser(kind, meta.ge, meta.le)
        parser = _accepted_number(number, struct, knob.name)
        more = {"parser": parser, "metavar": _WORDS[kind]}
    option = typer.Option(help=text, rich_help_panel=panel, **more)
    return Annotated[kind | None, option]


_WORDS = {int: "INT", float: "FLOAT"}


def _parser(
    kind: type[int] | type[float], least: float, most: float
) -> Callable[[str], int | float]:
    """A number within the limits of a knob; anything else is wrong usage."""

    def parse(text: str) -> int | float:
        try:
            value = kind(text)
        except ValueError:
            what = "whole number" if kind is int else "number"
            raise typer.BadParameter(f"{text!r} is no {what}") from None
        if not least <= value <= most:
            raise typer.BadParameter(f"{text} is not from {least:g} to {most:g}")
        return value

    return parse


def _accepted_number(
    number: Callable[[str], int | float], struct: type[msgspec.Struct], name: str
) -> Callable[[str], int | float]:
    """A number that the knobs take; what they refuse is wrong usage, too."""

    def parse(text: str) -> int | float:
        value = number(text)
        try:
            struct(**{name: value})
        except ValueError as reason:
            raise typer.BadParameter(str(reason)) from None
        return value

    return parse


def _kind(annotation: Any) -> tuple[Any, msgspec.Meta]:
    """The type of a knob, and what its annotations say of it together."""
    found = msgspec.Meta()
    while (arguments := get_args(annotation)) and annotation is not None:
        if get_origin(annotation) is Annotated:
            found = _joined_limits(found, arguments[1:])
        annotation = next(a for a in arguments if a is not type(None))
    return annotation, found


def _joined_limits(found: msgspec.Meta, more: tuple[Any, ...]) -> msgspec.Meta:
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
