"""Lengths that are typed into a page are read as the shoot file's reader reads them."""

import json
import math
from pathlib import Path

import pytest
from view_makers import Client, served

from lensfit.errors import LensfitError
from lensfit.preset.store import load_preset
from lensfit.workflow.shoot.crew_notation import length_mm
from lensfit.workflow.view.answers import typed_length_mm
from lensfit.workflow.view.lens_adjustments import LensAdjustments
from lensfit.workflow.view.lens_server import LensServer
from lensfit.workflow.view.viewed_lens import ViewedLens

PRIME = Path(__file__).parents[3] / "presets" / "prime_50" / "preset.json"


@pytest.mark.parametrize("text", ["1.5 m", "4'11\"", "59 1/2 in", "∞", "150cm"])
def test_a_length_is_that_of_a_shoot_file(text: str):
    assert typed_length_mm(text) == pytest.approx(length_mm(text, "", ""), rel=1e-12)


@pytest.mark.parametrize(("text", "mm"), [("800", 800), (" 1e3 ", 1000), ("-5", -5)])
def test_a_number_is_millimetres(text: str, mm: float):
    assert typed_length_mm(text) == mm


@pytest.mark.parametrize("text", ["near", "1500,0", "nan", "1e999", "5'13", "1 parsec"])
def test_what_is_no_length_is_a_sentence_of_people(text: str):
    with pytest.raises(LensfitError) as refused:
        typed_length_mm(text)
    said = str(refused.value)
    assert "=" not in said
    assert not said.startswith(":")
    assert len(said.split()) > 3


def test_pages_of_plates_and_of_lenses_answer_it(client: Client):
    lens = ViewedLens(load_preset(PRIME), "prime", LensAdjustments())
    with served(LensServer([lens])) as other:
        for one in (client, other):
            assert one.post("length", typed="2 m").json() == {"mm": 2000}
            infinite = one.post("length", typed="inf")
            assert json.loads(infinite.content) == {"mm": "inf"}
            assert one.post("length", typed="near").status == 422


def test_infinity_is_one():
    assert math.isinf(typed_length_mm("infinity"))
