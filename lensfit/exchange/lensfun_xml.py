"""lensfun's database files: lenses with their calibrations, keyed by focal length.

Distortion and lateral colour depend on the focal length alone there, vignetting also on
f-number and focus distance (metres).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from lensfit.errors import ExchangeError
from lensfit.exchange.lensfun import DistortionModel, centre_magnification
from lensfit.exchange.text_file import Element, finite_number, positive_number, read_xml
from lensfit.printable import printable

_KIND = "lensfun database"
_TERMS: dict[DistortionModel, tuple[str, ...]] = {
    "poly3": ("k1",),
    "poly5": ("k1", "k2"),
    "ptlens": ("a", "b", "c"),
}
_TCA = ("vr", "cr", "br", "vb", "cb", "bb")
_MOST_CALIBRATIONS = 2000
_LARGEST_COEFFICIENT = 1e6
_LEAST_CENTRE = 0.01
"""Magnification in the middle."""


@dataclass(frozen=True)
class LensfunDistortion:
    """Distortion at a focal length; `real_focal_mm` is None when not measured."""

    focal_mm: float
    model: DistortionModel
    terms: tuple[float, ...]
    real_focal_mm: float | None = None


@dataclass(frozen=True)
class LensfunTca:
    """Lateral colour at a focal length; v, c, b of red and of blue."""

    focal_mm: float
    r: tuple[float, float, float]
    b: tuple[float, float, float]


@dataclass(frozen=True)
class LensfunVignetting:
    """Fall-off at a focal length, f-number and focus distance."""

    focal_mm: float
    f_number: float
    distance_m: float
    terms: tuple[float, float, float]


@dataclass(frozen=True)
class LensfunLens:
    """A lens of a database.

    Attributes
    ----------
    centre : Of distortion, in halves of the short side, x right, y down.
    projection : "rectilinear", "fisheye", ...
    """

    maker: str
    model: str
    crop_factor: float
    aspect_ratio: float
    distortions: tuple[LensfunDistortion, ...]
    tcas: tuple[LensfunTca, ...] = ()
    vignettings: tuple[LensfunVignetting, ...] = ()
    centre: tuple[float, float] = (0.0, 0.0)
    projection: str = "rectilinear"

    @property
    def name(self) -> str:
        """Maker and model; models often begin with the maker."""
        return self.model if self.maker in self.model else f"{self.maker} {self.model}"


@dataclass(frozen=True)
class LensfunDatabase:
    """Lenses of a file, and the crop factors of its cameras by name."""

    lenses: tuple[LensfunLens, ...]
    cameras: Mapping[str, float]


def read_lensfun(path: str | Path) -> LensfunDatabase:
    """Every lens of a database file.

    Raises
    ------
    ExchangeError : It is no lensfun database, or a number of it cannot be.
    """
    path = Path(path)
    root = read_xml(path, _KIND)
    if root.tag != "lensdatabase":
        raise ExchangeError(
            f"begins with <{root.tag[:40]}>, not <lensdatabase>",
            where=path,
            remedy="give a lensfun database file",
        )
    lenses = tuple(_lens(element, path) for element in root.all("lens"))
    if not lenses:
        raise ExchangeError("holds no lens", where=path)
    cameras = {}
    for element in root.all("camera"):
        crop = element.text_of("cropfactor")
        name = f"{_name(element, 'maker')} {_name(element, 'model')}".strip()
        if crop is not None and name:
            cameras[name] = positive_number(crop, f"{name}: cropfactor", path)
    return LensfunDatabase(lenses, cameras)


def lensfun_text(lens: LensfunLens, comments: tuple[str, ...]) -> str:
    """The database with one lens."""
    notes = [
        f"<!-- {re.sub('-{2,}', '-', escape(printable(c))).strip('-')} -->"
        for c in comments
    ]
    focals = [d.focal_mm for d in lens.distortions]
    lines = [
        *('<?xml version="1.0" encoding="utf-8"?>', '<lensdatabase version="1">'),
        *notes,
        "<mount><name>Generic</name></mount>",
        "<lens>",
        f"  <maker>{escape(printable(lens.maker))}</maker>",
        f"  <model>{escape(printable(lens.model))}</model>",
        "  <mount>Generic</mount>",
        f"  <focal min={_q(min(focals))} max={_q(max(focals))}/>",
        f"  <type>{escape(lens.projection)}</type>",
        *_centre_lines(lens.centre),
        f"  <cropfactor>{lens.crop_factor!r}</cropfactor>",
        f"  <aspect-ratio>{lens.aspect_ratio!r}</aspect-ratio>",
        "  <calibration>",
        *(f"    {line}" for line in _calibration_lines(lens)),
        "  </calibration>",
        "</lens>",
        "</lensdatabase>",
    ]
    return "\n".join(lines) + "\n"


def _centre_lines(centre: tuple[float, float]) -> list[str]:
    x, y = centre
    return [f"  <center x={_q(x)} y={_q(y)}/>"] if x or y else []


def _calibration_lines(lens: LensfunLens) -> list[str]:
    lines = []
    for one in lens.distortions:
        real = {} if one.real_focal_mm is None else {"real-focal": one.real_focal_mm}
        terms = dict(zip(_TERMS[one.model], one.terms, strict=True))
        known = {"focal": one.focal_mm, **real, **terms}
        lines.append(f'<distortion model="{one.model}" {_attributes(known)}/>')
    for one in lens.tcas:
        known = {"focal": one.focal_mm, **dict(zip(_TCA, one.r + one.b, strict=True))}
        lines.append(f'<tca model="poly3" {_attributes(known)}/>')
    for one in lens.vignettings:
        known = {
            "focal": one.focal_mm,
            "aperture": one.f_number,
            "distance": one.distance_m,
            **dict(zip(("k1", "k2", "k3"), one.terms, strict=True)),
        }
        lines.append(f'<vignetting model="pa" {_attributes(known)}/>')
    return lines


def _attributes(values: Mapping[str, float]) -> str:
    return " ".join(f"{name}={_q(value)}" for name, value in values.items())


def _q(value: float) -> str:
    return quoteattr(repr(float(value)))


def _lens(element: Element, path: Path) -> LensfunLens:
    model = _name(element, "model")
    calibration = Element("calibration", {})
    crop, aspect = element.text_of("cropfactor"), element.text_of("aspect-ratio")
    for one in element.all("calibration"):
        calibration.children += one.children
        crop = one.attributes.get("cropfactor", crop)
        aspect = one.attributes.get("aspect-ratio", aspect)
    if len(calibration.children) > _MOST_CALIBRATIONS:
        raise ExchangeError(f"{model}: too many calibrations", where=path)
    kinds = {
        kind: calibration.all(kind) for kind in ("distortion", "tca", "vignetting")
    }
    centre = next(iter(element.all("center")), Element("center", {}))
    return LensfunLens(
        maker=_name(element, "maker"),
        model=model,
        crop_factor=positive_number(crop or "1", f"{model}: cropfactor", path),
        aspect_ratio=_aspect_ratio(aspect or "1.5", model, path),
        distortions=tuple(
            found
            for one in kinds["distortion"]
            if (found := _distortion(one, model, path)) is not None
        ),
        tcas=tuple(
            found
            for one in kinds["tca"]
            if (found := _tca(one, model, path)) is not None
        ),
        vignettings=tuple(_vignetting(one, model, path) for one in kinds["vignetting"]),
        centre=(
            _value(centre, "x", model, path, default="0"),
            _value(centre, "y", model, path, default="0"),
        ),
        projection=element.text_of("type") or "rectilinear",
    )


def _name(element: Element, tag: str) -> str:
    """The name in no language; those with `lang` are translations."""
    plain = [e.text for e in element.all(tag) if "lang" not in e.attributes]
    return (plain or [e.text for e in element.all(tag)] or [""])[0][:200]


def _distortion(element: Element, lens: str, path: Path) -> LensfunDistortion | None:
    name = element.attributes.get("model", "")
    model: DistortionModel | None = next((k for k in _TERMS if k == name), None)
    if model is None:
        return None
    terms = tuple(_value(element, t, lens, path, default="0") for t in _TERMS[model])
    if not centre_magnification(model, terms) > _LEAST_CENTRE:
        raise ExchangeError(
            f"{lens}: {model} of {', '.join(map(str, terms))} leaves no picture",
            where=path,
        )
    real = element.attributes.get("real-focal")
    return LensfunDistortion(
        positive_number(element.attributes.get("focal", ""), f"{lens}: focal", path),
        model,
        terms,
        None if real is None else positive_number(real, f"{lens}: real-focal", path),
    )


def _tca(element: Element, lens: str, path: Path) -> LensfunTca | None:
    focal = positive_number(element.attributes.get("focal", ""), f"{lens}: focal", path)
    model = element.attributes.get("model", "")
    if model == "linear":
        r, b = (_value(element, k, lens, path, default="1") for k in ("kr", "kb"))
        return LensfunTca(focal, (r, 0.0, 0.0), (b, 0.0, 0.0))
    if model != "poly3":
        return None
    vr, cr, br, vb, cb, bb = (
        _value(element, term, lens, path, default="1" if term[0] == "v" else "0")
        for term in _TCA
    )
    return LensfunTca(focal, (vr, cr, br), (vb, cb, bb))


def _vignetting(element: Element, lens: str, path: Path) -> LensfunVignetting:
    focal, f_number, distance = (
        positive_number(element.attributes.get(key, ""), f"{lens}: {key}", path)
        for key in ("focal", "aperture", "distance")
    )
    k1, k2, k3 = (_value(element, k, lens, path) for k in ("k1", "k2", "k3"))
    return LensfunVignetting(focal, f_number, distance, (k1, k2, k3))


def _value(
    element: Element, key: str, lens: str, path: Path, default: str = ""
) -> float:
    what = f"{lens}: {element.tag} {key}"
    value = finite_number(element.attributes.get(key, default), what, path)
    if abs(value) > _LARGEST_COEFFICIENT:
        raise ExchangeError(f"{what} = {value:g} is out of range", where=path)
    return value


def _aspect_ratio(text: str, lens: str, path: Path) -> float:
    parts = [
        positive_number(p, f"{lens}: aspect-ratio", path) for p in text.split(":", 1)
    ]
    ratio = parts[0] / parts[-1] if len(parts) == 2 else parts[0]
    if not 0.01 <= ratio <= 100:
        raise ExchangeError(f"{lens}: aspect-ratio {ratio:g} is none", where=path)
    return max(ratio, 1 / ratio)
