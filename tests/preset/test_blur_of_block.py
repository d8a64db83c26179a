"""Blur blocks: through the optics, through the file, and without it."""

import math
from pathlib import Path

import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
from preset_makers import make_blur, make_entry, make_preset

import lensfit
from lensfit.optics.aberration import Aberration
from lensfit.optics.terms import decentring_terms, rotational_terms
from lensfit.preset.blocks import Blur
from lensfit.preset.blur_of_block import aberration_of, blur_block, pupil_of


def rebuilt(blur: Blur) -> Blur:
    """The block of the optics of a block."""
    return blur_block(
        aberration_of(blur),
        pupil_of(blur.pupil),
        pupil_magnification=blur.pupil_magnification,
        reference_distance_mm=blur.reference_distance_mm,
        focus_offset_mm=blur.focus_offset_mm,
        stops=blur.stops,
        round_f_number=blur.round_f_number,
        band_centres_nm=blur.band_centres_nm,
        band_widths_nm=blur.band_widths_nm,
        assumed=blur.assumed,
    )


def test_a_blur_survives_the_optics():
    blur = make_blur()
    assert rebuilt(blur) == blur
    squeezed = msgspec.structs.replace(blur.pupil, squeeze=1.87, rims=())
    there = rebuilt(make_blur(pupil=squeezed, aberrations=())).pupil
    assert there.squeeze == pytest.approx(1.87, rel=1e-15)
    assert there.rims == ()


def test_optics_survive_the_block():
    """Also where a term is there for its colour alone."""
    rng = np.random.default_rng(3)
    terms, colours = rotational_terms(5), rotational_terms(3) + decentring_terms()
    aberration = Aberration(
        coefficients_um=jnp.asarray(rng.normal(size=len(terms))),
        colour_um=jnp.asarray(rng.normal(size=(2, len(colours)))),
        field_radius_mm=jnp.asarray(15.0),
        reference_sine=jnp.asarray(0.3),
        exit_pupil_distance_mm=jnp.asarray(80.0),
        chief_bend=jnp.asarray(0.01),
        terms=terms,
        colour_terms=colours,
    )
    blur = blur_block(
        aberration,
        pupil_of(make_blur().pupil),
        pupil_magnification=1.0,
        reference_distance_mm=math.inf,
        focus_offset_mm=0.0,
        stops=(),
        round_f_number=1.4,
    )
    back = aberration_of(blur)
    um = dict(zip(back.terms, np.asarray(back.coefficients_um), strict=True))
    colour = dict(zip(back.colour_terms, np.asarray(back.colour_um).T, strict=True))
    assert set(um) == set(terms) | set(colours)
    for term, value in zip(terms, np.asarray(aberration.coefficients_um), strict=True):
        assert um[term] == value
    for term, pair in zip(colours, np.asarray(aberration.colour_um).T, strict=True):
        np.testing.assert_array_equal(colour[term], pair)
    assert all(um[term] == 0 for term in colours if term not in terms)


@pytest.mark.parametrize("distance_mm", [2000.0, math.inf])
def test_a_blur_survives_the_file(tmp_path: Path, distance_mm: float):
    entry = make_entry(blur=make_blur(reference_distance_mm=distance_mm))
    lensfit.save_preset(make_preset(entry), tmp_path / "p.json")
    assert lensfit.load_preset(tmp_path / "p.json").entries == (entry,)


def test_a_preset_without_blur_says_nothing_of_it(tmp_path: Path):
    """So that files of before and after are the same."""
    lensfit.save_preset(make_preset(), tmp_path / "p.json")
    text = (tmp_path / "p.json").read_text()
    assert "blur" not in text
    assert "predicted" not in text


def test_blades_only_where_asked():
    pupil = make_blur().pupil
    assert pupil_of(pupil).blades == 7
    assert pupil_of(pupil, bladed=False).blades == 0
