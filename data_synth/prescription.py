"""Published lens prescriptions: the TOML files beside this module, as records.

A file gives each surface as a row {r, t, nd, vd, sd}: radius, distance to the next
surface, index and Abbe number of what follows (air when absent), semi-diameter, in the
unit of the publication; `scale` turns them into mm. Further keys of a row: `stop`,
`conic`, `even` (a4, a6, ...), `cylinder` ("x" or "y": the section that has power),
`sellmeier`. `state` tables give the thicknesses of a zoom by surface number (from 0).
`focus_group` = [first, last] names the surfaces that move; the whole lens by default.
`floating_groups` = [[first, last, share], ...] move along, each by a share of that
movement. An anamorphic may name `anamorphic_focus_group`: cylinders that then sharpen
the x section.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from data_synth.glass import AIR, Glass, glass_from_abbe, glass_from_sellmeier
from data_synth.surfaces import Surface

FOLDER = Path(__file__).parent / "prescriptions"


@dataclass(frozen=True)
class ZoomState:
    """One focal length of a lens: the airspaces that differ, mm by surface number."""

    focal_length_mm: float
    thicknesses_mm: dict[int, float]


@dataclass(frozen=True)
class Prescription:
    """A lens as published.

    Attributes
    ----------
    name : Name of the file, what `lensfit synth` calls the lens.
    title, source : What it is and where it was published.
    f_number : Widest stop.
    sensor_size_mm : Width and height that it is meant for, mm.
    squeeze : Anamorphic squeeze; 1 for an ordinary lens.
    surfaces : Of the first state, mm, the last thickness as published.
    states : One for each focal length.
    focus_group : First and last surface that move in focusing.
    anamorphic_focus_group : Cylinders that then move to sharpen the x section.
    floating_groups : First and last surface of others, and the share of the movement
        of the focus group that they make.
    """

    name: str
    title: str
    source: str
    f_number: float
    sensor_size_mm: tuple[float, float]
    squeeze: float
    surfaces: tuple[Surface, ...]
    states: tuple[ZoomState, ...]
    focus_group: tuple[int, int]
    anamorphic_focus_group: tuple[int, int] | None = None
    floating_groups: tuple[tuple[int, int, float], ...] = ()

    def state_nearest(self, focal_length_mm: float | None) -> ZoomState:
        """The published state closest to a focal length; the first for None."""
        if focal_length_mm is None:
            return self.states[0]
        return min(
            self.states, key=lambda state: abs(state.focal_length_mm - focal_length_mm)
        )


def prescription_names() -> list[str]:
    """Names of all bundled prescriptions."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_prescription(name: str | Path) -> Prescription:
    """Read a bundled prescription by name, or a file of the same form.

    Raises
    ------
    ValueError
        For a name that is neither bundled nor a file.
    """
    path = FOLDER / f"{name}.toml"
    if not path.is_file():
        path = Path(name)
    if not path.is_file():
        known = ", ".join(prescription_names())
        raise ValueError(f"no prescription named {name}; bundled are {known}")
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return _prescription(path.stem, table)


def _prescription(name: str, table: dict) -> Prescription:
    scale = table.get("scale", 1.0)
    surfaces = tuple(_surface(row, scale) for row in table["surfaces"])
    states = tuple(
        ZoomState(
            state["focal_length_mm"],
            {int(key): value * scale for key, value in state["t"].items()},
        )
        for state in table.get("state", [])
    )
    first, last = table.get("focus_group", [0, len(surfaces) - 1])
    width, height = table["sensor_size_mm"]
    return Prescription(
        name=name,
        title=table["title"],
        source=table["source"],
        f_number=table["f_number"],
        sensor_size_mm=(width, height),
        squeeze=table.get("squeeze", 1.0),
        surfaces=surfaces,
        states=states or (ZoomState(table["focal_length_mm"], {}),),
        focus_group=(first, last),
        anamorphic_focus_group=_pair(table.get("anamorphic_focus_group")),
        floating_groups=tuple(
            (first, last, float(share))
            for first, last, share in table.get("floating_groups", [])
        ),
    )


def _pair(values: list[int] | None) -> tuple[int, int] | None:
    return (values[0], values[1]) if values else None


def _surface(row: dict, scale: float) -> Surface:
    curvature = 1.0 / (row["r"] * scale) if row.get("r") else 0.0
    section = row.get("cylinder", "xy")
    even = row.get("even", [])
    return Surface(
        curvature_x_per_mm=curvature if "x" in section else 0.0,
        curvature_y_per_mm=curvature if "y" in section else 0.0,
        thickness_mm=row["t"] * scale,
        semi_diameter_mm=row["sd"] * scale,
        glass=_glass(row),
        conic=row.get("conic", 0.0),
        even_coefficients=tuple(
            value / scale ** (2 * power - 1)
            for power, value in enumerate(even, start=2)
        ),
        is_stop=row.get("stop", False),
    )


def _glass(row: dict) -> Glass:
    if "sellmeier" in row:
        return glass_from_sellmeier(tuple(row["sellmeier"]))
    return glass_from_abbe(row["nd"], row["vd"]) if "nd" in row else AIR
