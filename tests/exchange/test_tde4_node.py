"""Nuke text of 3DEqualizer's nodes: what is written is read, the rest is refused."""

import math
from pathlib import Path

import pytest

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import StatedValues
from lensfit.exchange.tde4 import ANAMORPHIC, RADIAL, Tde4Map
from lensfit.exchange.tde4_node import (
    lens_of_tde4,
    read_tde4_nodes,
    tde4_node_text,
)

PASTED = """set cut_paste_input [stack 0]
version 13.2 v2
push $cut_paste_input
Group {
 name Group1
 selected true
}
 LD_3DE4_Anamorphic_Standard_Degree_4 {
  tde4_focal_length_cm 3.5
  tde4_filmback_width_cm 3.6000000000000005
  tde4_filmback_height_cm 2.0250000000000004
  Cx02_Degree_2 0.05
  Lens_Rotation {-1.5}
  Squeeze_X 1.1
  label "a \\"lens\\" } with a brace"
  name lens1
 }
end_group
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "lens.nk"
    path.write_text(text)
    return path


def test_what_is_written_is_read_bit_for_bit(tmp_path: Path):
    knobs = {"Distortion_Degree_2": 0.1 / 3, "Phi_Cylindric_Direction": -12.5}
    made = Tde4Map(RADIAL, knobs, (24.89, 18.6675), (0.01, -0.02))
    text = tde4_node_text(
        made,
        focal_length_mm=51.3,
        focus_distance_mm=math.inf,
        name="SMC Takumar 50/1.4",
        label='rms 0.01 px, [value x] {"quoted"} $var\nsecond line',
    )
    (node,) = read_tde4_nodes(written(tmp_path, text))
    assert node.name == "SMC_Takumar_50_1_4"
    assert node.map.knobs["Distortion_Degree_2"] == 0.1 / 3
    assert node.map.knobs["Phi_Cylindric_Direction"] == -12.5
    assert node.map.filmback_mm == pytest.approx((24.89, 18.6675), rel=1e-15)
    assert node.map.centre_mm == pytest.approx((0.01, -0.02), rel=1e-15)
    assert node.focal_length_mm == pytest.approx(51.3, rel=1e-15)
    assert node.focus_distance_mm == math.inf
    assert text.startswith("# rms 0.01 px")


def test_a_node_inside_a_pasted_group_is_found(tmp_path: Path):
    (node,) = read_tde4_nodes(written(tmp_path, PASTED))
    assert node.map.model == ANAMORPHIC
    assert node.map.knobs["Squeeze_X"] == 1.1
    assert node.map.knobs["Squeeze_Y"] == 1.0
    assert node.map.knobs["Lens_Rotation"] == -1.5
    assert node.map.filmback_mm == pytest.approx((36.0, 20.25))
    assert node.focus_distance_mm is None


def test_of_two_nodes_one_must_be_named(tmp_path: Path):
    path = written(tmp_path, PASTED + PASTED.replace("lens1", "lens2"))
    nodes = read_tde4_nodes(path)
    with pytest.raises(ExchangeError, match="lens1, lens2; say with --lens"):
        lens_of_tde4(nodes, StatedValues(), path)
    assert lens_of_tde4(nodes, StatedValues(lens="lens2"), path).name == "lens2"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("LD_3DE_Classic_LD_Model {\n Distortion 0.1\n}\n", "LD_3DE_Classic_LD_Model"),
        ("Blur {\n size 3\n}\n", "holds none"),
        ("", "holds none"),
        (PASTED.replace("0.05", "{{curve x1 0.05 x2 0.06}}"), "is animated"),
        (PASTED.replace("0.05", "[value root.x]"), "is animated or an expression"),
        (PASTED.replace("0.05", "nan"), "is animated or an expression"),
        (PASTED.replace("0.05", "1e999"), "is not finite"),
        (PASTED.replace("Squeeze_X 1.1", "Squeeze_X 0"), "is not positive"),
        (PASTED.replace("3.6000000000000005", "-3"), "is not positive"),
        (PASTED[: PASTED.index("Squeeze_X")], "is cut off inside the node"),
        (
            PASTED.replace(" name lens1", " name l\n field_of_view_xb_unit 0.5"),
            "sees a part of the frame",
        ),
    ],
)
def test_what_cannot_be_is_one_sentence(tmp_path: Path, text: str, said: str):
    path = written(tmp_path, text)
    with pytest.raises(ExchangeError, match=r"lens\.nk: ") as caught:
        read_tde4_nodes(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
