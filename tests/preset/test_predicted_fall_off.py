"""Fall-off predicted from the pupil: its own light, nature's when closed, and on top of
what was measured at another stop."""

from math import comb

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
from preset_makers import make_blur, make_entry, make_preset

from lensfit.optics.falloff import log_loss
from lensfit.optics.pupil import relative_illumination
from lensfit.preset.blocks import FallOff, Pupil
from lensfit.preset.blur_of_block import lens_blur
from lensfit.preset.predicted_fall_off import (
    predicted_fall_off,
    with_predicted_fall_off,
)

EDGE_MM = 15.6
RADII_MM = np.linspace(0, EDGE_MM, 60)


_loss = jax.jit(jax.vmap(log_loss, (0, None)))
_through_pupil = jax.jit(jax.vmap(relative_illumination, (0, None, None)))


def illumination_of(fall_off: FallOff) -> np.ndarray:
    squared = jnp.asarray((RADII_MM / fall_off.valid_radius_mm) ** 2)
    loss = _loss(squared, jnp.asarray(fall_off.g))
    return np.exp(-np.asarray(loss))


@pytest.mark.parametrize("f_number", [1.4, 2.0, 2.8, 11.0])
def test_it_is_the_light_through_the_pupil(f_number: float):
    entry = make_entry(blur=make_blur(), fall_off=())
    (predicted,) = predicted_fall_off(entry, [f_number], EDGE_MM)
    assert (predicted.f_number, predicted.predicted) == (f_number, True)
    blur = lens_blur(entry, f_number, 2000.0)
    way = np.array([0.6, 0.8])
    points = jnp.asarray(RADII_MM[:, None] * way / blur.aberration.field_radius_mm)
    truth = _through_pupil(points, blur.stop_radius, blur.pupil)
    assert float(truth[-1]) < 0.95
    np.testing.assert_allclose(illumination_of(predicted), truth, rtol=0.01)


def test_stopped_down_it_falls_to_natural_fall_off():
    """A stretch of cos^3 along and cos across is the foreshortened disc of cos^4."""
    distance_mm = 60.0
    tangent = EDGE_MM / distance_mm
    # ln cos = -t^2/2 + t^4/4, of |h|^2 and |h|^4.
    first, second = -(tangent**2) / 2, tangent**4 / 4
    pupil = Pupil(
        rims=make_blur().pupil.rims,
        stretch_along=(3 * first, 3 * second),
        stretch_across=(first, second),
    )
    blur = make_blur(pupil=pupil, field_radius_mm=EDGE_MM)
    entry = make_entry(blur=blur, fall_off=())
    natural = (1 + (RADII_MM / distance_mm) ** 2) ** -2.0
    wide, closed = predicted_fall_off(entry, [1.4, 11.0], EDGE_MM)
    np.testing.assert_allclose(illumination_of(closed), natural, rtol=2e-3)
    assert illumination_of(wide)[-1] < 0.7 * natural[-1]


def test_natural_fall_off_that_no_dot_shows_is_kept():
    """A pupil without foreshortening, and a lens that was measured to have it: closed,
    the light is nature's, at the stop that was photographed and at others."""
    distance_mm = 30.0
    natural = (1 + (RADII_MM / distance_mm) ** 2) ** -2.0
    share = np.linspace(0, 1, 40)
    loss = 2 * np.log1p(share * (EDGE_MM / distance_mm) ** 2)
    steps = np.polynomial.polynomial.polyvander(share, 6)[:, 1:]
    power = np.linalg.lstsq(steps, loss)[0]
    degree = len(power)
    control = tuple(
        sum(comb(i, j) / comb(degree, j) * power[j - 1] for j in range(1, i + 1))
        for i in range(1, degree + 1)
    )
    measured = FallOff(8.0, EDGE_MM, control, control, control)
    pupil = Pupil(rims=make_blur().pupil.rims)
    blur = make_blur(pupil=pupil, field_radius_mm=EDGE_MM)
    entry = make_entry(blur=blur, fall_off=(measured,))
    closed, wide = predicted_fall_off(entry, [16.0, 1.4])
    np.testing.assert_allclose(illumination_of(closed), natural, rtol=5e-3)
    (alone,) = predicted_fall_off(
        msgspec.structs.replace(entry, fall_off=()), [1.4], EDGE_MM
    )
    together = natural * illumination_of(alone)
    np.testing.assert_allclose(illumination_of(wide), together, rtol=0.02)


def test_stopping_down_never_darkens_the_corner():
    entry = make_entry(blur=make_blur(), fall_off=())
    found = predicted_fall_off(entry, [1.4, 1.8, 2.2, 2.8, 4.0], EDGE_MM)
    corners = [illumination_of(one)[-1] for one in found]
    assert np.all(np.diff(corners) > -1e-3)
    assert corners[-1] > 1.5 * corners[0]


def test_measured_and_predicted_stops_interpolate_alike():
    entry = make_entry(blur=make_blur())
    measured = entry.fall_off[:1]
    both = measured + predicted_fall_off(entry, [2.8, 5.6])
    preset = make_preset(msgspec.structs.replace(entry, fall_off=both))
    between = preset.select(50.0, 2.0).entry.fall_off[0]
    assert between.predicted
    assert not preset.select(50.0, 1.4).entry.fall_off[0].predicted
    light = [
        illumination_of(preset.select(50.0, n).entry.fall_off[0])[-1]
        for n in (1.4, 2.0, 2.8)
    ]
    assert light[0] < light[1] < light[2]


def test_an_entry_without_blur_predicts_nothing():
    with pytest.raises(ValueError, match="no blur"):
        predicted_fall_off(make_entry(), [2.8])


def test_full_stops_that_were_not_photographed_are_added():
    measured = FallOff(2.8, EDGE_MM, *[(0.0, 0.05, 0.2)] * 3)
    entry = make_entry(blur=make_blur(), fall_off=(measured,))
    found = {one.f_number: one for one in with_predicted_fall_off(entry).fall_off}
    assert found[2.8] == measured
    assert {1.4, 2.0, 4.0, 5.6, 11.0} <= set(found)
    assert all(one.predicted for number, one in found.items() if number != 2.8)
    assert min(found) >= min(stop.f_number for stop in entry.blur.stops) / 1.05


def test_nothing_is_predicted_without_a_blur_or_an_f_number():
    nameless = FallOff(None, EDGE_MM, *[(0.0, 0.05, 0.2)] * 3)
    for entry in (make_entry(), make_entry(blur=make_blur(), fall_off=(nameless,))):
        assert with_predicted_fall_off(entry) == entry


def test_a_lens_says_that_its_fall_off_is_predicted():
    measured = FallOff(2.8, EDGE_MM, *[(0.0, 0.05, 0.2)] * 3)
    entry = make_entry(blur=make_blur(), fall_off=(measured,))
    preset = make_preset(with_predicted_fall_off(entry))
    said = {n: " ".join(preset.at(f_number=n).notes) for n in (2.8, 5.6)}
    assert "predicted" not in said[2.8]
    assert "fall-off at f/5.6 is predicted" in said[5.6]
