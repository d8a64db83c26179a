"""Covariances on disk: every bit kept, and refused where no numbers vary so."""

from pathlib import Path

import msgspec
import pytest
from known_entries import CONTROL, covariance_of, known_entry
from preset_makers import make_entry, make_preset

from lensfit.errors import PresetError
from lensfit.preset.blocks import LateralCovariance
from lensfit.preset.covariance import Covariance
from lensfit.preset.store import load_preset, save_preset


def test_presets_keep_every_bit_of_it(tmp_path: Path):
    preset = make_preset(known_entry())
    save_preset(preset, tmp_path / "p.json")
    assert load_preset(tmp_path / "p.json") == preset
    text = (tmp_path / "p.json").read_text()
    older = make_preset(make_entry())
    save_preset(older, tmp_path / "older.json")
    assert text.count('"covariance"') == 4
    assert (tmp_path / "older.json").read_text().count('"covariance"') == 1


GOOD = covariance_of(CONTROL, 1e-3, 0)


@pytest.mark.parametrize(
    ("bad", "what"),
    [
        ({"parameters": ("r[0]", "r[2]")}, r"'r\[2\]' is none of"),
        ({"parameters": ("r[0]", "r[0]")}, "twice"),
        ({"standard_deviation": (1e-3,)}, "needs 2 numbers"),
        ({"standard_deviation": (1e-3, -1e-3)}, "negative"),
        ({"standard_deviation": (1e-3, float("nan"))}, "no finite number"),
        ({"correlation": ((1.0,), (1.0,))}, "rows of 1 to 2"),
        ({"correlation": ((1.0,), (1.2, 1.0))}, "beyond -1 to 1"),
        ({"correlation": ((1.0,), (0.2, 0.9))}, "does not end with 1"),
    ],
)
def test_covariances_that_cannot_be_are_refused(tmp_path: Path, bad, what):
    light = known_entry().fall_off[0]
    assert light.covariance is not None
    known = msgspec.structs.replace(
        light.covariance, r=msgspec.structs.replace(GOOD, **bad)
    )
    light = msgspec.structs.replace(light, covariance=known)
    preset = make_preset(make_entry(fall_off=(light,)))
    with pytest.raises(PresetError, match=what) as fault:
        save_preset(preset, tmp_path / "p.json")
    assert "fall_off[0].covariance.r" in str(fault.value)


def test_correlations_of_no_numbers_are_refused(tmp_path: Path):
    impossible = Covariance(
        ("shift_mm[0]", "shift_mm[1]", "radial[0]"),
        (1e-3, 1e-3, 1e-3),
        ((1.0,), (0.9, 1.0), (-0.9, 0.9, 1.0)),
    )
    colour = known_entry().lateral_colour
    assert colour is not None
    known = LateralCovariance(impossible, Covariance((), (), ()))
    colour = msgspec.structs.replace(colour, covariance=known)
    preset = make_preset(make_entry(lateral_colour=colour))
    with pytest.raises(PresetError, match=r"lateral_colour\.covariance\.r\.corr"):
        save_preset(preset, tmp_path / "p.json")
