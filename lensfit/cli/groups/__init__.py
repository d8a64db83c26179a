"""Options that belong together, one file per group, shared by the commands.

A group is a frozen dataclass whose fields are annotated as typer wants them; a command
takes a whole group as one parameter, under `takes_groups`.
"""

import dataclasses
import functools
import inspect
from collections.abc import Callable
from typing import Any


def takes_groups(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameters that are groups became the options of these groups."""
    own = inspect.signature(command).parameters.values()
    groups: dict[str, Any] = {
        p.name: p.annotation for p in own if dataclasses.is_dataclass(p.annotation)
    }
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
        filled = {
            name: group(
                **{f.name: given.pop(f.name) for f in dataclasses.fields(group)}
            )
            for name, group in groups.items()
        }
        command(**given, **filled)

    # typer reads the one, and the types of the other
    run.__signature__ = inspect.Signature(options)  # pyright: ignore[reportAttributeAccessIssue]
    run.__annotations__ = {option.name: option.annotation for option in options}
    return run


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
