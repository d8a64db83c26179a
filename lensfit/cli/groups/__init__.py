"""Options that belong together, one file per group, shared by the commands.

A group is a frozen dataclass whose fields are annotated as typer wants them; a command
takes a whole group as one parameter, under `takes_groups`.
"""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any


def takes_groups(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameters that are groups became the options of these groups."""
    own = inspect.signature(command).parameters.values()
    groups = _groups(command)
    options = [
        option
        for parameter in own
        for option in (
            _options(parameter.annotation)
            if parameter.name in groups
            else [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)]
        )
    ]

    @functools.wraps(command)
    def run(**given: Any) -> None:
        command(**options_in_groups(command, given))

    # typer reads the one, and the types of the other
    run.__signature__ = inspect.Signature(options)  # pyright: ignore[reportAttributeAccessIssue]
    run.__annotations__ = {option.name: option.annotation for option in options}
    return run


def options_in_groups(
    command: Callable[..., None], given: Mapping[str, Any]
) -> dict[str, Any]:
    """Values of the options of a command, with those of a group put into the group.

    Parameters
    ----------
    command : As it is written, or as `takes_groups` made it.
    given : By name of the option; options that are left out stay out.
    """
    rest, filled = dict(given), {}
    for name, group in _groups(command).items():
        own = [f.name for f in dataclasses.fields(group)]
        filled[name] = group(**{n: rest.pop(n) for n in own if n in rest})
    return rest | filled


def _groups(command: Callable[..., None]) -> dict[str, Any]:
    written = inspect.signature(inspect.unwrap(command)).parameters.values()
    return {
        p.name: p.annotation for p in written if dataclasses.is_dataclass(p.annotation)
    }


def _options(group: type) -> list[inspect.Parameter]:
    return [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=field.default,
            annotation=field.type,
        )
        for field in dataclasses.fields(group)
    ]
