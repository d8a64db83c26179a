"""Colour that a file stored at lower resolution is given back by a model of dots."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drawn_lens import Seidel, Shot, photographed

from lensfit.chroma import ChromaBlocks, codes_after_storage
from lensfit.detect.dot_images import StoredColour
from lensfit.fitting.wavefront.dot_data import DotData, LightAsStored, select_dots
from lensfit.fitting.wavefront.lost_colour import restore_colour
from lensfit.io.transfer import decode, encode

BLOCKS = ChromaBlocks((2, 2))


def stored_dots(surround: float) -> tuple[DotData, np.ndarray]:
    """Dots with fringes of a cell from a file that lost them, of which the second
    photograph lost nothing; and what they were."""
    dots = photographed(Seidel(), [Shot(0, 0), Shot(0, 1)], noise=0.0)
    light = 0.05 + 0.7 * dots.light / dots.light.max()
    light = np.stack([np.roll(light[:, 0], k, -1) for k in (-1, 0, 1)], 1)
    seen = surround - light if surround else light
    corner = np.random.default_rng(0).integers(0, 50, (len(light), 2))
    given = codes_after_storage(encode(seen, "srgb"), corner, BLOCKS)
    kept = decode(given, "srgb")
    kept = surround - kept if surround else kept
    lost = dots.take == 0
    kept[~lost] = light[~lost]
    each = np.full(light.shape[:2], surround)
    stored = [StoredColour(BLOCKS, "srgb", each[lost]), None]
    found = replace(
        dots,
        photographs=tuple(
            SimpleNamespace(dot_images=SimpleNamespace(stored=one)) for one in stored
        ),
        light=kept,
        as_stored=LightAsStored(kept, each, corner),
    )
    return found, light


@pytest.mark.parametrize("surround", [0.0, 0.9])
def test_a_true_model_gives_back_what_was_lost(surround: float):
    dots, light = stored_dots(surround)
    assert np.abs(dots.light - light).max() > 0.05
    np.testing.assert_allclose(restore_colour(dots, light).light, light, atol=1e-6)


def test_what_is_restored_twice_is_restored_from_the_file():
    dots, light = stored_dots(0.9)
    again = restore_colour(restore_colour(dots, 0.8 * light), light)
    np.testing.assert_allclose(again.light, light, atol=1e-6)
    some = np.array([3, 1])
    few = restore_colour(select_dots(dots, some), light[some])
    np.testing.assert_allclose(few.light, light[some], atol=1e-6)


def test_a_model_without_fringes_changes_nothing():
    dots, _ = stored_dots(0.0)
    grey = np.repeat(dots.light[:, 1:2], 3, 1)
    np.testing.assert_allclose(restore_colour(dots, grey).light, dots.light, atol=1e-6)
