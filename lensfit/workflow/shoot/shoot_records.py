"""The records of a shoot: lens, camera, targets, takes, each key with its unit.

Lengths are millimetres; `focus_distance_mm` and `target_distance_mm` are from the
sensor plane, as on the barrel. None means that the value is not stated.
"""

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from lensfit.errors import ShootError
from lensfit.mosaic import Mosaic

PositiveFloat = Annotated[float, Meta(gt=0)]
SMALLEST_F_NUMBER, LARGEST_F_NUMBER = 0.3, 512.0
"""Below the fastest lens that air allows, and beyond the stops of large formats."""
FNumber = Annotated[float, Meta(ge=SMALLEST_F_NUMBER, le=LARGEST_F_NUMBER)]
Squeeze = Annotated[float, Meta(ge=0.25, le=4)]
"""Twice what lenses are built with, either way."""
PitchMm = Annotated[float, Meta(ge=1e-3, le=1e5)]
"""From a micrometre, of charts for microscopes, to a hundred metres."""
# msgspec 0.22 reads memory it should not when a union joins a number with bounds and a
# tuple of fixed length, so the length is a bound here.
PitchPairMm = Annotated[tuple[PitchMm, ...], Meta(min_length=2, max_length=2)]
Name = Annotated[str, Meta(min_length=1)]
MarkCount = Annotated[int, Meta(ge=5, le=255)]


class LensName(Struct, frozen=True, forbid_unknown_fields=True):
    """Which lens: the name engraved on it, and its serial number."""

    name: Name
    serial: str | None = None


class Camera(Struct, frozen=True, forbid_unknown_fields=True):
    """The sensor area that a photograph spans, mm; None where the header knows it.

    Attributes
    ----------
    mosaic : Colours of the top left 2 x 2 photosites of every photograph as it is
        stored, row by row: each pixel measured one, and the others were interpolated.
    """

    model: str | None = None
    sensor_width_mm: PositiveFloat | None = None
    sensor_height_mm: PositiveFloat | None = None
    mosaic: Mosaic | None = None


class Target(Struct, frozen=True, forbid_unknown_fields=True):
    """A flat chart of dots, lines or squares.

    Attributes
    ----------
    pitch_mm : Distance of neighbouring dots, lines or corners; one number, or [x, y].
        An asymmetric circle grid states the pitch of its full rows and columns.
    hole_diameter_mm : Diameter of a dot.
    line_width_mm : Width of a line.
    polarity : "bright" marks on black or "dark" on white; found from the image if None.
    asymmetric : Every other row of a circle grid is shifted by half a pitch.
    squares : Columns and rows of squares of a ChArUco board, or of a checkerboard.
    dictionary : ArUco dictionary of a ChArUco board, "DICT_5X5_250" and the like.
    marker_ratio : Side of a marker divided by that of its square.
    marks : Columns and rows of a dot or line grid made by lensfit: marks are then
        numbered by the chart's orientation marks, where they are seen. Charts that
        are read from their code have it; a checkerboard has `squares`.
    """

    name: Name
    kind: Literal["dot-grid", "line-grid", "checkerboard", "circle-grid", "charuco"]
    pitch_mm: PitchMm | PitchPairMm
    hole_diameter_mm: PositiveFloat | None = None
    line_width_mm: PositiveFloat | None = None
    polarity: Literal["bright", "dark"] | None = None
    asymmetric: bool | None = None
    squares: tuple[Annotated[int, Meta(ge=2)], Annotated[int, Meta(ge=2)]] | None = None
    dictionary: Name | None = None
    marker_ratio: Annotated[float, Meta(gt=0, lt=1)] | None = None
    marks: tuple[MarkCount, MarkCount] | None = None

    @property
    def pitch_xy_mm(self) -> tuple[float, float]:
        """Pitch to the right and down on the target, mm."""
        if isinstance(self.pitch_mm, tuple):
            return self.pitch_mm[0], self.pitch_mm[1]
        return self.pitch_mm, self.pitch_mm


class Take(Struct, frozen=True, forbid_unknown_fields=True):
    """One photograph of one target, and the state of the lens it was taken with.

    Attributes
    ----------
    image : Path as written, relative to the shoot file.
    target : Name of a target; None to read the chart's code, here or on another take.
    focal_length_mm : As on the barrel.
    f_number : As on the barrel.
    focus_distance_mm : From the sensor; may be infinite.
    anamorphic_squeeze : Nominal horizontal squeeze.
    target_distance_mm : From the sensor; None when unknown, and then fitted.
    roi : x0, y0, x1, y1, pixels: where on the photograph to look.
    encoding : How the file stores light; None means what the file type usually does.
    """

    image: Name
    target: Name | None = None
    focal_length_mm: PositiveFloat | None = None
    f_number: FNumber | None = None
    focus_distance_mm: PositiveFloat | None = None
    anamorphic_squeeze: Squeeze | None = None
    target_distance_mm: PositiveFloat | None = None
    roi: tuple[float, float, float, float] | None = None
    encoding: Name | None = None


class ShootFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The tables of a shoot file, under their own names."""

    lens: LensName
    take: Annotated[list[Take], Meta(min_length=1)]
    target: list[Target] = []
    camera: Camera = Camera()


class Shoot(Struct, frozen=True):
    """A shoot file that does not contradict itself.

    Attributes
    ----------
    path : The file.
    targets : By name.
    takes : In the order of the file.
    notes : Oddities that are worth saying and stop nothing.
    images : Folder that the photographs' paths count from, if not the file's own.
    unconfirmed : Keys that were drafted and whose lines still say TODO.
    """

    path: Path
    lens: LensName
    camera: Camera
    targets: dict[str, Target]
    takes: tuple[Take, ...]
    notes: tuple[str, ...] = ()
    images: Path | None = None
    unconfirmed: tuple[str, ...] = ()

    def image_path(self, take: Take) -> Path:
        """Where the photograph of a take lies."""
        return (self.images or self.path.parent) / take.image

    def target_of(self, take: Take) -> Target:
        """The target a take shows.

        Raises
        ------
        ShootError : Neither the take nor a chart's code says.
        """
        if take.target is None:
            raise ShootError(
                "no target is stated and no chart's code can be read",
                where=f"{self.path}: {take.image}",
                remedy='state [[target]] and add target = "its name" to the take',
            )
        return self.targets[take.target]
