"""The records of a kit file: camera, charts, and lenses with their stops and marks.

Lengths are millimetres; distances are from the sensor plane, as on the barrel. Values
under `[defaults]` hold for every lens that does not state them itself.
"""

from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from lensfit.workflow.shoot.shoot_records import Name, PositiveFloat, Target

Count = Annotated[int, Meta(ge=0, le=8)]


class KitCamera(Struct, frozen=True, forbid_unknown_fields=True):
    """The body that every lens of the kit is photographed with.

    Attributes
    ----------
    sensor_width_mm, sensor_height_mm : Of the area that photographs span.
    image_size_px : Width and height of the photographs; without it no blur can be
        planned.
    mosaic : As in a shoot file.
    """

    sensor_width_mm: PositiveFloat
    sensor_height_mm: PositiveFloat | None = None
    model: str | None = None
    image_size_px: tuple[int, int] | None = None
    mosaic: str | None = None


class Metered(Struct, frozen=True, forbid_unknown_fields=True):
    """The exposure that suits the chart, as metered at one f-number at infinity.

    Attributes
    ----------
    shutter_s : Exposure time.
    """

    f_number: PositiveFloat
    shutter_s: PositiveFloat
    iso: PositiveFloat | None = None


class Pace(Struct, frozen=True, forbid_unknown_fields=True):
    """How long a crew takes, beside the exposures.

    Attributes
    ----------
    per_view_s : To set ring and iris, slate and shoot.
    per_lens_s : To change the lens, frame the chart and check the first view.
    """

    per_view_s: PositiveFloat = 40.0
    per_lens_s: PositiveFloat = 300.0


class FocusMark(Struct, frozen=True):
    """A mark of the focus scale.

    Attributes
    ----------
    engraved : As the barrel has it, 4'11" or 1.5 m.
    distance_mm : What that is; may be infinite.
    """

    engraved: str
    distance_mm: float


class KitLens(Struct, frozen=True, forbid_unknown_fields=True):
    """One lens, and what is photographed of it.

    Attributes
    ----------
    lens_set : The set it belongs to, whose lenses should match.
    folder : Of its photographs, from the kit file; made from name and serial if None.
    focal_lengths_mm : One of a prime; those to photograph of a zoom.
    f_numbers : At every mark, widest first.
    focus_marks : At which the standing chart is photographed.
    target : Name of the chart; the only one if None.
    target_distance_mm : Where it stands; where its pattern fills the frame if None.
    tilted_views : Of the chart turned by `TILT_DEG`, for each focal length; without
        them the focal length cannot be told from the chart's distance.
    file_format : Ending of the photographs' names.
    """

    name: Name
    focal_lengths_mm: Annotated[list[PositiveFloat], Meta(min_length=1)]
    f_numbers: Annotated[list[PositiveFloat], Meta(min_length=1)]
    focus_marks: Annotated[list[FocusMark], Meta(min_length=1)]
    serial: str | None = None
    lens_set: str | None = None
    folder: Name | None = None
    target: Name | None = None
    target_distance_mm: PositiveFloat | None = None
    tilted_views: Count = 1
    anamorphic_squeeze: PositiveFloat | None = None
    encoding: Name | None = None
    file_format: Name = ".exr"

    @property
    def title(self) -> str:
        """Name and serial number, for people."""
        return f"{self.name} s/n {self.serial}" if self.serial else self.name


class KitFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The tables of a kit file, under their own names."""

    camera: KitCamera
    lens: Annotated[list[KitLens], Meta(min_length=1)]
    name: str = "Lens kit"
    target: list[Target] = []
    exposure: Metered | None = None
    pace: Pace = Pace()


class Kit(Struct, frozen=True):
    """A kit file that does not contradict itself.

    Attributes
    ----------
    path : The file; folders of lenses count from where it lies.
    lenses : By folder, in the order of the file.
    """

    path: Path
    name: str
    camera: KitCamera
    targets: dict[str, Target]
    lenses: dict[str, KitLens]
    exposure: Metered | None
    pace: Pace

    def target_of(self, lens: KitLens) -> Target:
        """The chart of a lens."""
        return self.targets[lens.target or next(iter(self.targets))]

    def folder_of(self, key: str) -> Path:
        """Where the photographs of a lens lie."""
        return self.path.parent / key
