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


def settable_prescription(
    option: str,
    name: str,
    f_number: float | None,
    focus_option: str,
    focus_distance_mm: float | None,
) -> "Prescription":
    """A prescription that can be set to an f-number and a focus distance.

    Raises
    ------
    typer.BadParameter : There is none, it opens less, or the focus is too near.
    """
    prescription = prescription_of(option, name)
    widest = prescription.f_number
    if f_number is not None and not widest <= f_number < float("inf"):
        raise typer.BadParameter(f"--f-number {f_number:g}: {name} opens to {widest:g}")
    nearest_mm = 10 * max(state.focal_length_mm for state in prescription.states)
    if focus_distance_mm is None or nearest_mm <= focus_distance_mm < float("inf"):
        return prescription
    raise typer.BadParameter(
        f"{focus_option} {focus_distance_mm:g}: "
        f"give at least {nearest_mm:g} mm (ten focal lengths)"
    )
