"""The camera or lens state on the command line, and the files that know it."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lensfit.plate.camera.sources import CameraOptions, StateOverrides

_PANEL = "Camera"
_UNITS = ("mm", "cm", "m", "in", "ft")
_MOST_PX = 1e6


ScaleToSensorOption = Annotated[
    bool,
    typer.Option(
        "--scale-to-sensor",
        help="Put the look on a focal length or sensor that it was not measured at: by "
        "field angle, beyond those in units of the frame",
        rich_help_panel=_PANEL,
    ),
]


@dataclass(frozen=True)
class CameraGroup:
    """What is known better than the header knows it."""

    focal_length_mm: Annotated[
        float | None,
        typer.Option(help="In place of all others', mm", rich_help_panel=_PANEL),
    ] = None
    f_number: Annotated[
        float | None,
        typer.Option(help="In place of all others'", rich_help_panel=_PANEL),
    ] = None
    focus_distance_mm: Annotated[
        float | None,
        typer.Option(
            help="In place of all others', mm from the sensor; inf is allowed",
            rich_help_panel=_PANEL,
        ),
    ] = None
    sensor_width_mm: Annotated[
        float | None,
        typer.Option(
            help="Width that the frame spans on the sensor, mm", rich_help_panel=_PANEL
        ),
    ] = None
    settings: Annotated[
        Path | None,
        typer.Option(
            help="In place of every lensfit.toml beside and above the plate",
            rich_help_panel=_PANEL,
        ),
    ] = None
    metadata: Annotated[
        list[Path] | None,
        typer.Option(
            "--metadata",
            "--camera",
            metavar="FILE",
            help="Sidecar (ARRI, RED, Sony, Canon, Blackmagic, ALE, Mo-Sys F4, "
            "OpenTrackIO) or camera (.chan, .nk, USD); "
            "repeat for more, the first that knows a value counts",
            rich_help_panel=_PANEL,
        ),
    ] = None
    metadata_start: Annotated[
        int | None,
        typer.Option(
            metavar="FRAME",
            help="Frame number of a sidecar's first row; by timecode if left out",
            rich_help_panel=_PANEL,
        ),
    ] = None
    camera_name: Annotated[
        str | None,
        typer.Option(help="Camera of a .nk or USD file", rich_help_panel=_PANEL),
    ] = None
    camera_unit: Annotated[
        str | None,
        typer.Option(
            help="Unit of a .nk camera's focal_point: mm, cm, m, in, ft; metres if "
            "left out",
            rich_help_panel=_PANEL,
        ),
    ] = None

    def overrides(self) -> "StateOverrides":
        """What is stated outright."""
        from lensfit.plate.camera.sources import StateOverrides

        return StateOverrides(
            self.focal_length_mm,
            self.f_number,
            self.focus_distance_mm,
            self.sensor_width_mm,
        )

    def sources(self, focus_at: tuple[float, ...] | None = None) -> "CameraOptions":
        """Where else the camera is described.

        Parameters
        ----------
        focus_at : What the user picked to be in focus.

        Raises
        ------
        typer.BadParameter : Focus is both stated and picked, or a word is no unit.
        """
        from lensfit.plate.camera.sources import CameraOptions

        if self.camera_unit is not None and self.camera_unit not in _UNITS:
            raise typer.BadParameter(
                f"{self.camera_unit!r} is not one of {', '.join(_UNITS)}",
                param_hint="--camera-unit",
            )
        if focus_at is not None and self.focus_distance_mm is not None:
            raise typer.BadParameter(
                "give it or --focus-distance-mm, not both", param_hint="--focus-at"
            )
        return CameraOptions(
            tuple(self.metadata or ()),
            self.metadata_start,
            self.camera_name,
            self.camera_unit,
            self.settings,
            focus_at,
        )


@dataclass(frozen=True)
class FocusGroup:
    """What is in focus, of a plate with depth."""

    focus_at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y[,X1,Y1]",
            help="Focus on what lies at a pixel of the frame, or (median) in a region",
            rich_help_panel=_PANEL,
        ),
    ] = None

    def pick(self) -> tuple[float, ...] | None:
        """The pixel or region.

        Raises
        ------
        typer.BadParameter : It is neither.
        """
        if self.focus_at is None:
            return None
        try:
            numbers = tuple(float(word) for word in self.focus_at.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) not in (2, 4) or not all(abs(n) < _MOST_PX for n in numbers):
            raise typer.BadParameter(
                f"{self.focus_at!r} is not X,Y or X0,Y0,X1,Y1", param_hint="--focus-at"
            )
        return numbers


@dataclass(frozen=True)
class PixelGroup:
    """What counts in place of the header's ``pixelAspectRatio``."""

    pixel_aspect: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=10.0,
            help="Width of a pixel over its height as displayed, in place of a "
            "header's; of an anamorphic lens 1 is a desqueezed plate, its squeeze a "
            "squeezed one",
            rich_help_panel="Camera",
        ),
    ] = None


@dataclass(frozen=True)
class StateGroup:
    """Which state of the lens is meant."""

    focal_length_mm: Annotated[
        float | None, typer.Option(help="Of the lens, mm", rich_help_panel="Lens")
    ] = None
    focus_distance_mm: Annotated[
        float | None,
        typer.Option(
            help="Of the lens, mm from the sensor; inf is allowed",
            rich_help_panel="Lens",
        ),
    ] = None
    f_number: Annotated[
        float | None, typer.Option(help="Of the lens", rich_help_panel="Lens")
    ] = None


@dataclass(frozen=True)
class FrameGroup:
    """The picture that the other program sees."""

    size: Annotated[
        str | None,
        typer.Option(
            help="Of the frame, as 4096x3072; that of the photographs by default",
            rich_help_panel="Picture",
        ),
    ] = None
    overscan: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=200.0,
            help="Percent beyond the frame in total: 10 is 5 on each side",
            rich_help_panel="Picture",
        ),
    ] = 0.0
    sensor_width_mm: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            help="Width that the frame spans on the sensor, mm",
            rich_help_panel="Picture",
        ),
    ] = None
