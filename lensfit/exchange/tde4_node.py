"""3DEqualizer's distortion nodes for Nuke, as script text.

The node knows its filmback and lens centre in centimetres, y up; its picture is the
frame from unit coordinate 0 to 1. Values that are animated are refused: a preset entry
is one state of the lens.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
    export_result,
    lens_description,
    principal_point,
    samples_pair,
)
from lensfit.exchange.foreign import (
    ForeignLens,
    ForeignState,
    StatedValues,
    assumed_size_px,
)
from lensfit.exchange.nuke_script import (
    NukeNode,
    node_text,
    quoted_word,
    read_nuke_nodes,
)
from lensfit.exchange.samples import residual_of
from lensfit.exchange.tde4 import ANAMORPHIC, KNOBS, RADIAL, RESCALED, Tde4Map, fit_tde4
from lensfit.exchange.text_file import finite_number, positive_number

_FAMILY = re.compile(r"(?:tde4_)?LD_3DE4?_\w+")
_BUILT_IN = {
    "tde4_focal_length_cm": 1.0,
    "tde4_custom_focus_distance_cm": 100.0,
    "tde4_filmback_width_cm": 0.8,
    "tde4_filmback_height_cm": 0.6,
    "tde4_lens_center_offset_x_cm": 0.0,
    "tde4_lens_center_offset_y_cm": 0.0,
    "tde4_pixel_aspect": 1.0,
}
"""What the kit's nodes start with, and so leave out of a script."""
_FIELD_OF_VIEW = {"xa": 0.0, "xb": 1.0, "ya": 0.0, "yb": 1.0}
_MM_PER_CM = 10.0
_SHOWN = 8
_FARTHEST_MM = 1e7
"""The knob has no infinity; ten kilometres are one for a lens."""


@dataclass(frozen=True, eq=False)
class Tde4Node:
    """A node: the model, and the camera that it states."""

    map: Tde4Map
    name: str
    focal_length_mm: float
    focus_distance_mm: float | None


def read_tde4_nodes(path: str | Path) -> tuple[Tde4Node, ...]:
    """The nodes of a script whose model is known here.

    Raises
    ------
    ExchangeError : It holds none, one of another model, an animated value, or a value
        that cannot be.
    """
    found = [n for n in read_nuke_nodes(path) if _FAMILY.fullmatch(n.kind)]
    known = [n for n in found if n.kind in KNOBS]
    if not known:
        other = f"a {found[0].kind[:80]}, whose model is not read" if found else "none"
        raise ExchangeError(
            f"should hold a 3DEqualizer lens node and holds {other}",
            where=path,
            remedy=f"known here: {', '.join(KNOBS)}; or hand over its UV map",
        )
    return tuple(_node(node, path) for node in known)


def lens_of_tde4(
    nodes: tuple[Tde4Node, ...], stated: StatedValues, where: str | Path
) -> ForeignLens:
    """The lens of one node: the only one, or the one whose name was stated.

    Raises
    ------
    ExchangeError : There are several and none was stated, or not one of them.
    """
    chosen = [n for n in nodes if stated.lens in (None, n.name)]
    if len(chosen) != 1:
        names = ", ".join(n.name for n in nodes[:_SHOWN])
        raise ExchangeError(
            f"holds the lens nodes {names}",
            where=where,
            remedy="say with --lens which of them is meant",
        )
    node = chosen[0]
    filmback = node.map.filmback_mm
    size = stated.size_px or assumed_size_px(filmback)
    focal = stated.focal_length_mm or node.focal_length_mm
    state = ForeignState(
        map=node.map,
        principal_distance_mm=node.focal_length_mm,
        principal_point_mm=node.map.centre_mm,
        focal_length_mm=focal,
        focus_distance_mm=stated.focus_distance_mm or node.focus_distance_mm,
    )
    notes = ()
    if node.map.pixel_aspect != 1:
        notes = ("the node's pixel aspect became part of the lens' squeeze",)
    return ForeignLens(
        "3DEqualizer node", node.name, filmback, size, (state,), notes=notes
    )


def tde4_node_text(
    model: Tde4Map,
    *,
    focal_length_mm: float,
    focus_distance_mm: float | None,
    name: str,
    label: str,
) -> str:
    """The node that undistorts, as script text, with what it is as comment and label.

    Parameters
    ----------
    focal_length_mm : Of the pinhole of the undistorted picture.
    label : What the artist should know, in lines.
    """
    width, height = model.filmback_mm
    camera = {
        "tde4_focal_length_cm": focal_length_mm / _MM_PER_CM,
        "tde4_custom_focus_distance_cm": _finite_focus(focus_distance_mm) / _MM_PER_CM,
        "tde4_filmback_width_cm": width / _MM_PER_CM,
        "tde4_filmback_height_cm": height / _MM_PER_CM,
        "tde4_lens_center_offset_x_cm": model.centre_mm[0] / _MM_PER_CM,
        "tde4_lens_center_offset_y_cm": -model.centre_mm[1] / _MM_PER_CM,
        "tde4_pixel_aspect": model.pixel_aspect,
    }
    values = camera | (KNOBS[model.model] | dict(model.knobs))
    knobs = {"direction": "undistort"}
    knobs |= {k: repr(float(v)) for k, v in values.items()}
    knobs |= {f"field_of_view_{k}_unit": repr(v) for k, v in _FIELD_OF_VIEW.items()}
    knobs |= {"name": re.sub(r"\W+", "_", name) or "lens", "label": quoted_word(label)}
    comment = "".join(f"# {line}\n" for line in label.splitlines())
    return comment + node_text(model.model, knobs)


def _node(node: NukeNode, path: str | Path) -> Tde4Node:
    def value(knob: str, default: float) -> float:
        return _plain_value(node, knob, default, path)

    camera = {k: value(k, default) for k, default in _BUILT_IN.items()}
    for corner, default in _FIELD_OF_VIEW.items():
        if value(f"field_of_view_{corner}_unit", default) != default:
            raise ExchangeError(
                f"the node {node.name} sees a part of the frame (field of view)",
                where=path,
                remedy="export the camera with the field of view from 0 to 1",
            )
    for key in (
        "tde4_filmback_width_cm",
        "tde4_filmback_height_cm",
        "tde4_focal_length_cm",
        "tde4_pixel_aspect",
    ):
        positive_number(camera[key], f"{node.name}: {key}", path)
    knobs = {k: value(k, default) for k, default in KNOBS[node.kind].items()}
    _check_stretch(knobs, node, path)
    return Tde4Node(
        Tde4Map(
            node.kind,
            knobs,
            (
                camera["tde4_filmback_width_cm"] * _MM_PER_CM,
                camera["tde4_filmback_height_cm"] * _MM_PER_CM,
            ),
            (
                camera["tde4_lens_center_offset_x_cm"] * _MM_PER_CM,
                -camera["tde4_lens_center_offset_y_cm"] * _MM_PER_CM,
            ),
            camera["tde4_pixel_aspect"],
        ),
        node.name,
        camera["tde4_focal_length_cm"] * _MM_PER_CM,
        _focus_of(node, camera["tde4_custom_focus_distance_cm"] * _MM_PER_CM),
    )


def _check_stretch(
    knobs: Mapping[str, float], node: NukeNode, path: str | Path
) -> None:
    for key in ("Squeeze_X", "Squeeze_Y", "Rescale"):
        positive_number(knobs.get(key, 1.0), f"{node.name}: {key}", path)
    if knobs.get("B_Cylindric_Bending", 0.0) <= -1:
        raise ExchangeError(
            f"{node.name}: B_Cylindric_Bending is -1 or less", where=path
        )


def _plain_value(node: NukeNode, knob: str, default: float, path: str | Path) -> float:
    text = node.knobs.get(knob)
    if text is None:
        return default
    text = text.strip('{} "')
    if re.search(r"[A-Za-z\[]", re.sub(r"[eE][-+]?\d+$", "", text)):
        raise ExchangeError(
            f"{node.name}: {knob} is animated or an expression",
            where=path,
            remedy="bake the node to one frame",
        )
    return finite_number(text, f"{node.name}: {knob}", path)


def _focus_of(node: NukeNode, stated_mm: float) -> float | None:
    """Unknown where the script leaves the knob out: then it is the kit's default."""
    if "tde4_custom_focus_distance_cm" not in node.knobs or stated_mm <= 0:
        return None
    return math.inf if stated_mm >= _FARTHEST_MM else stated_mm


def _finite_focus(focus_distance_mm: float | None) -> float:
    return min(focus_distance_mm or _FARTHEST_MM, _FARTHEST_MM)


TDE4_FORMATS = {
    "nuke-radial": RADIAL,
    "nuke-anamorphic": ANAMORPHIC,
    "nuke-anamorphic-rescaled": RESCALED,
}


def export_tde4(model: str, request: ExportRequest) -> Exported:
    """A Nuke node of 3DEqualizer's kit."""
    lens, frame = request.lens(), request.frame
    fit, judge = samples_pair(lens, frame)
    fitted = fit_tde4(model, fit, principal_point(lens))
    residual = residual_of(fitted, judge)
    text = tde4_node_text(
        fitted,
        focal_length_mm=float(lens.distortion.principal_distance_mm),
        focus_distance_mm=lens.focus_distance_mm,
        name=request.preset.lens.name,
        label=f"{lens_description(request, lens)}\nresidual {residual} over {frame}",
    )
    write_text_atomic(request.out, text)
    return export_result(request, lens, (Nearness("distortion", residual),))
