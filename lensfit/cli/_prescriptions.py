"""A lens to be traced, as the command line names it."""

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from data_synth.prescription import Prescription


def prescription_of(option: str, name: str) -> "Prescription":
    """The bundled prescription of that name, or that of a file.

    Raises
    ------
    typer.BadParameter : There is neither, or the file holds none; `option` says where.
    """
    from data_synth.prescription import load_prescription

    try:
        return load_prescription(name)
    except (ValueError, KeyError, TypeError) as error:
        raise typer.BadParameter(f"{option} {name}: {error}") from error
