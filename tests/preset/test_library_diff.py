"""The difference of two presets: which keys, by how much, by how many deviations."""

import math

import msgspec
import numpy as np
import pytest
from preset_makers import make_blur, make_entry, make_preset

from lensfit.preset.blocks import Covariance
from lensfit.preset.entry import Entry
from lensfit.preset.knobs import adjusted_knobs
from lensfit.preset.library.diff import deviations_of, differences
from lensfit.preset.library.key_path import MISSING

PLACE = "entries[focal_length_mm=50,focus_distance_mm=2000]"


def with_distortion(entry: Entry, **changes: object) -> Entry:
    distortion = msgspec.structs.replace(entry.distortion, **changes)
    return msgspec.structs.replace(entry, distortion=distortion)


def known(**deviations: float) -> Covariance:
    """Independent parameters; `radial_0` is radial[0]."""
    names = tuple(f"{n[:-2]}[{n[-1]}]" for n in deviations)
    return Covariance.from_matrix(names, np.diag(list(deviations.values())) ** 2)


def test_a_preset_does_not_differ_from_itself():
    preset = make_preset(make_entry(blur=make_blur()))
    assert differences(preset, preset) == []


def test_entries_are_matched_by_what_they_are():
    near, far = make_entry(), make_entry(focus_distance_mm=math.inf)
    assert differences(make_preset(near, far), make_preset(far, near)) == []
    (only,) = differences(make_preset(near, far), make_preset(near))
    assert only.key == "entries[focal_length_mm=50,focus_distance_mm=inf]"
    assert only.b is MISSING


def test_numbers_are_told_relative_and_in_deviations():
    one = make_entry(covariance=known(radial_0=3e-3))
    two = with_distortion(
        make_entry(covariance=known(radial_0=4e-3)),
        radial_log_slope=(-0.09, 1 / 3, 1e-17),
    )
    (found,) = differences(make_preset(one), make_preset(two))
    assert found.key == f"{PLACE}.distortion.radial_log_slope[0]"
    assert found.relative == pytest.approx(0.1)
    assert found.deviations == pytest.approx(2.0)  # .01 over hypot(.003, .004)
    (back,) = differences(make_preset(two), make_preset(one))
    assert back.deviations == pytest.approx(-2.0)


def test_what_appears_and_what_cannot_be_relative():
    plain = make_preset()
    knobs = adjusted_knobs(plain.knobs, {"bloom_gain": 0.25})
    glowing = msgspec.structs.replace(plain, knobs=knobs)
    (found,) = differences(plain, glowing)
    assert found == ("knobs.look.bloom_gain", 0.0, 0.25, None, None)
    (colour,) = differences(plain, make_preset(make_entry(lateral_colour=None)))
    assert colour.key == f"{PLACE}.lateral_colour"
    assert colour.b is None


def test_lists_of_other_lengths_differ_where_one_ends():
    shorter = with_distortion(make_entry(), decentering=(1e-4, -2e-4))
    found = differences(make_preset(), make_preset(shorter))
    keys = [d.key.rpartition(".")[2] for d in found]
    assert keys == ["decentering[2]", "decentering[3]"]


def test_deviations_are_in_the_unit_of_their_key():
    entry = make_entry(
        covariance=known(
            focal_length_0=1e-4, principal_point_1=1e-3, free_field_5=2e-6, other_0=1.0
        )
    )
    found = deviations_of(make_preset(entry))
    assert found == {
        f"{PLACE}.projection.principal_distance_mm": pytest.approx(51.3e-4),
        f"{PLACE}.projection.principal_point_mm[1]": pytest.approx(15.6e-3),
        f"{PLACE}.distortion.field.y[1]": pytest.approx(2e-6),
    }


def test_the_squeeze_has_the_deviation_of_many_draws():
    """Draws of e = ln s (cos 2a, sin 2a) around the fitted one."""
    matrix = np.array([[4e-6, 1e-6], [1e-6, 2e-6]])
    entry = make_entry(
        covariance=Covariance.from_matrix(("squeeze[0]", "squeeze[1]"), matrix)
    )
    size, angle = math.log(1.9), 0.02
    mean = size * np.array([math.cos(angle), math.sin(angle)])
    e1, e2 = np.random.default_rng(7).multivariate_normal(mean, matrix, 20_000).T
    found = deviations_of(make_preset(entry))
    squeeze = np.std(np.exp(np.hypot(e1, e2)))
    azimuth = np.std(np.arctan2(e2, e1) / 2)
    key = f"{PLACE}.distortion.squeeze"
    assert found[key] == pytest.approx(squeeze, rel=0.02)
    assert found[f"{key}_axis_rad"] == pytest.approx(azimuth, rel=0.02)
