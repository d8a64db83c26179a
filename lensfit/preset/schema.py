"""A preset: one lens on one camera, an entry per focal length and focus distance.

The file is JSON, schema "lensfit.preset.2"; every key names its unit. A change of the
meaning of a key raises the number in the schema and adds a step to
`lensfit.preset.store`. Reading and checking a preset needs no JAX.
"""

from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta, Struct

from lensfit.preset.blocks import Camera
from lensfit.preset.entry import Entry
from lensfit.preset.knobs import NEUTRAL, Knobs
from lensfit.preset.select_entry import Selection, select
from lensfit.preset.verdict_levels import Verdict

if TYPE_CHECKING:
    from lensfit.lens import Lens

SCHEMA = "lensfit.preset.2"
CONVENTIONS = (
    "Lengths in mm, angles in rad; origin at the sensor centre, x right, y down; "
    "radii and coefficients without a unit count in reference_radius_mm from the "
    "principal point; distances from the sensor plane."
)


class LensName(Struct, frozen=True, forbid_unknown_fields=True):
    """Which lens this is."""

    name: str
    serial: str | None = None


class SourceImage(Struct, frozen=True, forbid_unknown_fields=True):
    """A photograph the preset was made from, and what it was used for."""

    path: str
    sha256: str
    role: str


class Provenance(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the numbers come from.

    Attributes
    ----------
    created : Date and time, ISO 8601 with time zone.
    lensfit_version : Of the program that made it.
    versions : Of the libraries the result may depend on.
    images : Every photograph.
    shoot_sha256 : Hash of the shoot file.
    """

    created: str
    lensfit_version: str
    versions: dict[str, str]
    images: tuple[SourceImage, ...]
    shoot_sha256: str | None = None


class Saved(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Who put a preset where it is, and what it was made of.

    Attributes
    ----------
    who, when : The latter ISO 8601 with time zone.
    note : Why, in words.
    origin : The version of a library that it was taken from.
    edits : What was changed on top of that, one sentence each.
    """

    who: str
    when: str
    note: str = ""
    origin: str = ""
    edits: tuple[str, ...] = ()


class Preset(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A measured lens: load one with `lensfit.load_preset`.

    Attributes
    ----------
    knobs : Adjustments made since; neutral knobs are not written.
    saved : How it came into a library or out of it; None before.
    verdict : What its calibration was judged to be good for; None if not judged.
    """

    schema: Literal["lensfit.preset.2"] = SCHEMA
    conventions: str = CONVENTIONS
    lens: LensName
    camera: Camera
    entries: Annotated[tuple[Entry, ...], Meta(min_length=1)]
    provenance: Provenance
    knobs: Knobs = NEUTRAL
    saved: Saved | None = None
    verdict: Verdict | None = None

    def select(
        self,
        focal_length_mm: float | None = None,
        f_number: float | None = None,
        focus_distance_mm: float | None = None,
    ) -> Selection:
        """The entry at a lens state, and notes for its user.

        See `lensfit.preset.select_entry.select` for the rules of interpolation.
        """
        return select(
            self.entries,
            focal_length_mm=focal_length_mm,
            f_number=f_number,
            focus_distance_mm=focus_distance_mm,
        )

    def at(
        self,
        focal_length_mm: float | None = None,
        f_number: float | None = None,
        focus_distance_mm: float | None = None,
        *,
        knobs: Knobs | None = None,
    ) -> "Lens":
        """The lens at a state; what is left out is taken from the preset.

        Parameters
        ----------
        focal_length_mm : As on the barrel; may be left out of a preset with one.
        f_number : Wide open, as far as it was measured, when left out.
        focus_distance_mm : From the sensor plane; may be infinite.
        knobs : In place of the preset's own (its look is for the renderer).

        Raises
        ------
        PresetError : The preset does not reach that state; `select` says how far it
            is stretched when it does.
        """
        # Imported here, so that pipelines which only read presets never load JAX.
        from lensfit.preset.lens_of_entry import lens_of_selection

        chosen = self.select(focal_length_mm, f_number, focus_distance_mm)
        return lens_of_selection(chosen, self.camera, knobs or self.knobs)
