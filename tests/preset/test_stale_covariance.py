"""An edit of a measured number takes the deviation that it makes untrue with it."""

from pathlib import Path

import pytest
from known_entries import known_entry
from library_makers import ENTRY, change, keep
from preset_makers import make_preset

from lensfit.preset.entry import Entry
from lensfit.preset.library.diff import deviations_of


def known_blocks(entry: Entry) -> list[str]:
    """Which blocks say how well they are known."""
    colour = entry.lateral_colour
    assert colour is not None
    blocks = {
        "maps": entry.covariance,
        "colour": colour.covariance,
        **{f"f/{one.f_number:g}": one.covariance for one in entry.fall_off},
    }
    return [name for name, covariance in blocks.items() if covariance is not None]


@pytest.mark.parametrize(
    ("key", "value", "kept"),
    [
        ("distortion.squeeze", 2.0, ["colour", "f/1.4", "f/2.8"]),
        ("projection.principal_distance_mm", 52.0, ["colour", "f/1.4", "f/2.8"]),
        (
            "projection.entrance_pupil_offset_mm",
            50.0,
            ["maps", "colour", "f/1.4", "f/2.8"],
        ),
        ("lateral_colour.b.radial[0]", 1e-3, ["maps", "f/1.4", "f/2.8"]),
        ("fall_off[f_number=2.8].g[1]", 0.4, ["maps", "colour", "f/1.4"]),
        ("fall_off[1].b", [0.1, 0.4], ["maps", "colour", "f/1.4"]),
    ],
)
def test_what_was_set_by_hand_has_no_deviation(tmp_path: Path, key, value, kept):
    keep(tmp_path, make_preset(known_entry()))
    found = change(tmp_path, f"{ENTRY}.{key}", value, unlock=True)
    assert known_blocks(found.preset.entries[0]) == kept


def test_a_knob_changes_no_measurement(tmp_path: Path):
    keep(tmp_path, make_preset(known_entry()))
    found = change(tmp_path, "coma_gain", 0.5)
    assert found.preset.entries == make_preset(known_entry()).entries


def test_colour_and_light_have_their_deviations_under_their_keys():
    entry = known_entry()
    colour, light = entry.lateral_colour, entry.fall_off[1]
    assert colour is not None
    assert colour.covariance is not None
    assert light.covariance is not None
    found = deviations_of(make_preset(entry))
    for key, sd in (
        ("lateral_colour.r.shift_mm[1]", colour.covariance.r.standard_deviation[1]),
        ("lateral_colour.b.radial[0]", colour.covariance.b.standard_deviation[0]),
        ("fall_off[f_number=2.8].g[1]", light.covariance.g.standard_deviation[1]),
    ):
        assert found[f"{ENTRY}.{key}"] == sd
