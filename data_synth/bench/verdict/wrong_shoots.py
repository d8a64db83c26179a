"""What goes wrong with a shoot when people state it or shoot it, by kind.

Each case spoils a copy of a right shoot: the text of its shoot file, or its files. The
shoot is that of `WrongShoot`: dots in focus, nearer and farther at two f-numbers from
one place, one tilted, and a line grid, as linear 16-bit PNG.
"""

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import final

import cv2
import numpy as np

from lensfit.units import MILLIMETRES_PER_INCH

_TAKE = "[[take]]"
_NUMBER = r"([\d.]+)"
_FEET_PER_METRE = 3.2808


@final
@dataclass
class WrongShoot:
    """A copy of a right shoot, to be spoilt.

    Attributes
    ----------
    folder : With the photographs and ``shoot.toml``.
    text : Of the shoot file, written by `save`.
    """

    folder: Path
    text: str

    @classmethod
    def copy_of(cls, right: Path, folder: Path) -> "WrongShoot":
        """A copy, without what only the blur needs."""
        shutil.copytree(right, folder)
        text = (folder / "shoot.toml").read_text(encoding="utf-8")
        return cls(folder, re.sub(r"hole_diameter_mm.*\n", "", text))

    def save(self) -> Path:
        """Write the shoot file; its path."""
        path = self.folder / "shoot.toml"
        path.write_text(self.text, encoding="utf-8")
        return path

    @property
    def takes(self) -> list[str]:
        """The text of every take."""
        return self.text.split(_TAKE)[1:]

    @takes.setter
    def takes(self, takes: list[str]) -> None:
        self.text = _TAKE.join([self.text.split(_TAKE)[0], *takes])

    def image(self, k: int) -> str:
        """File of a take."""
        found = re.search(r'image = "(.*)"', self.takes[k])
        assert found is not None
        return found[1]

    def stated(self, key: str) -> float:
        """The first number stated under a key."""
        found = re.search(rf"^{key} = {_NUMBER}", self.text, re.MULTILINE)
        assert found is not None
        return float(found[1])

    def restate(self, key: str, change: Callable[[float], float]) -> None:
        """Put other numbers under a key, wherever it is stated."""
        self.text = re.sub(
            rf"^{key} = {_NUMBER}$",
            lambda found: f"{key} = {change(float(found[1])):.6g}",
            self.text,
            flags=re.MULTILINE,
        )

    def repaint(
        self, takes: list[int], change: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        """Put other samples into photographs; what `change` gives is clipped."""
        for k in takes:
            path = self.folder / self.image(k)
            picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert picture is not None
            made = change(picture.astype(np.float32) / 65535)
            codes = np.clip(np.round(65535 * made), 0, 65535)
            cv2.imwrite(str(path), codes.astype(np.uint16))

    def all_takes(self) -> list[int]:
        """Indices of every take."""
        return list(range(len(self.takes)))


@final
@dataclass(frozen=True)
class Wrong:
    """One way to be wrong.

    Attributes
    ----------
    kind : The word that it is told by.
    about : What was done.
    spoil : Does it.
    words : Any of them in the first line names the cause.
    """

    kind: str
    about: str
    spoil: Callable[[WrongShoot], None]
    words: tuple[str, ...]


def _pitches_swapped(shoot: WrongShoot) -> None:
    first = shoot.stated("pitch_mm")
    others = [float(one) for one in re.findall(rf"pitch_mm = {_NUMBER}", shoot.text)]
    second = next(one for one in others if one != first)
    shoot.restate("pitch_mm", lambda one: second if one == first else first)


def _one_axis(shoot: WrongShoot) -> None:
    pitch = shoot.stated("pitch_mm")
    pair = f"pitch_mm = [{pitch}, {1.5 * pitch}]"
    shoot.text = shoot.text.replace(f"pitch_mm = {pitch}", pair, 1)


def _stops_swapped(shoot: WrongShoot) -> None:
    stops = sorted({float(s) for s in re.findall(rf"f_number = {_NUMBER}", shoot.text)})
    other = {stops[0]: stops[1], stops[1]: stops[0]}
    shoot.restate("f_number", lambda one: other.get(one, one))


def _stop_tenfold(shoot: WrongShoot) -> None:
    widest = min(float(s) for s in re.findall(rf"f_number = {_NUMBER}", shoot.text))
    shoot.restate("f_number", lambda one: 10 * one if one == widest else one)


def _focus_in_wrong_order(shoot: WrongShoot) -> None:
    """In, near and far were shot, and near, far and in written down."""
    found = re.findall(rf"focus_distance_mm = {_NUMBER}", shoot.text)
    inside, near, far = list(dict.fromkeys(float(one) for one in found))[:3]
    other = {inside: near, near: far, far: inside}
    for k in range(min(6, len(shoot.takes))):
        _restated_in(shoot, k, "focus_distance_mm", other.__getitem__)


def _files_off_by_one(shoot: WrongShoot) -> None:
    takes = shoot.takes
    names = [shoot.image(k) for k in shoot.all_takes()]
    shifted = names[1:] + names[:1]
    shoot.takes = [
        take.replace(f'"{own}"', f'"{other}"')
        for take, own, other in zip(takes, names, shifted, strict=True)
    ]


def _lines_called_dots(shoot: WrongShoot) -> None:
    takes = shoot.takes
    first = re.search(r'target = "(.*)"', takes[0])
    assert first is not None
    takes[-1] = re.sub(r'target = ".*"', f'target = "{first[1]}"', takes[-1])
    shoot.takes = takes


def _sensor_sides_swapped(shoot: WrongShoot) -> None:
    width, height = shoot.stated("sensor_width_mm"), shoot.stated("sensor_height_mm")
    shoot.restate("sensor_width_mm", lambda _: height)
    shoot.restate("sensor_height_mm", lambda _: width)


def _other_sensor(factor: float) -> Callable[[WrongShoot], None]:
    def spoil(shoot: WrongShoot) -> None:
        shoot.restate("sensor_width_mm", lambda one: one * factor)
        shoot.restate("sensor_height_mm", lambda one: one * factor)

    return spoil


def _cropped(part: float, takes: slice) -> Callable[[WrongShoot], None]:
    """The middle of the frame, brought back to its size: a crop, or a zoom."""

    def enlarged(picture: np.ndarray) -> np.ndarray:
        height, width = picture.shape[:2]
        shift = np.array([[1 / part, 0, 0], [0, 1 / part, 0]])
        middle = np.array([width - 1, height - 1]) / 2
        shift[:, 2] = middle - middle / part
        return cv2.warpAffine(picture, shift, (width, height), flags=cv2.INTER_CUBIC)

    return lambda shoot: shoot.repaint(shoot.all_takes()[takes], enlarged)


def _resized(across: float, down: float, takes: slice) -> Callable[[WrongShoot], None]:
    def resized(picture: np.ndarray) -> np.ndarray:
        return cv2.resize(
            picture, None, fx=across, fy=down, interpolation=cv2.INTER_AREA
        )

    return lambda shoot: shoot.repaint(shoot.all_takes()[takes], resized)


def _stretched(shoot: WrongShoot) -> None:
    """To a wide picture, with the height of the sensor left to the program."""
    _resized(1.0, 0.75, slice(None))(shoot)
    shoot.text = re.sub(r"sensor_height_mm.*\n", "", shoot.text)


def _turned(shoot: WrongShoot) -> None:
    shoot.repaint([4], lambda picture: np.ascontiguousarray(np.rot90(picture)))


def _as_jpeg(shoot: WrongShoot) -> None:
    """Developed by another program, and still called linear."""
    for k in shoot.all_takes():
        name = shoot.image(k)
        picture = cv2.imread(str(shoot.folder / name), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        light = picture.astype(np.float32) / 65535
        coded = np.where(
            light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055
        )
        jpeg = Path(name).with_suffix(".jpg").name
        codes = np.clip(255 * coded, 0, 255).round().astype(np.uint8)
        cv2.imwrite(str(shoot.folder / jpeg), codes, [cv2.IMWRITE_JPEG_QUALITY, 97])
        shoot.text = shoot.text.replace(f'"{name}"', f'"{jpeg}"')


def _log_coded(shoot: WrongShoot) -> None:
    shoot.repaint(
        shoot.all_takes(), lambda light: np.log2(1 + 255 * np.maximum(light, 0)) / 8
    )


def _copies_saved_again(shoot: WrongShoot) -> None:
    """One photograph under three names, saved by another program each time."""
    takes = shoot.takes
    name = shoot.image(0)
    picture = cv2.imread(str(shoot.folder / name), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    for k, level in ((1, 1), (2, 9)):
        copy = f"again_{k}.png"
        path = str(shoot.folder / copy)
        cv2.imwrite(path, picture, [cv2.IMWRITE_PNG_COMPRESSION, level])
        takes[k] = takes[0].replace(f'"{name}"', f'"{copy}"')
    shoot.takes = takes


def _chart_moved(shoot: WrongShoot) -> None:
    """One view of a chart that stood a tenth farther away than all are stated."""
    _cropped(1.1, slice(3, 4))(shoot)


def _column_too_many(shoot: WrongShoot) -> None:
    first = shoot.stated("pitch_mm")
    shoot.restate(
        "pitch_mm", lambda one: round(first * 20 / 21, 3) if one == first else one
    )


def _restated_in(
    shoot: WrongShoot, take: int, key: str, change: Callable[[float], float]
) -> None:
    """Put another number under a key of one take."""
    takes = shoot.takes
    takes[take] = re.sub(
        rf"{key} = {_NUMBER}",
        lambda found: f"{key} = {change(float(found[1])):.6g}",
        takes[take],
    )
    shoot.takes = takes


def _metres_in_one_view(shoot: WrongShoot) -> None:
    _restated_in(shoot, 3, "target_distance_mm", lambda one: one / 1000)


def _stops_of_two_views(shoot: WrongShoot) -> None:
    """Of the near views wide open and stopped down."""
    stops = sorted({float(s) for s in re.findall(rf"f_number = {_NUMBER}", shoot.text)})
    _restated_in(shoot, 1, "f_number", lambda _: stops[1])
    _restated_in(shoot, 4, "f_number", lambda _: stops[0])


def _squeezed(shoot: WrongShoot) -> None:
    """The squeeze of another lens is stated; of an anamorphic one, its is forgotten."""
    if "anamorphic_squeeze" in shoot.text:
        shoot.text = re.sub(r"anamorphic_squeeze.*\n", "", shoot.text)
    else:
        stated = "encoding = "
        shoot.text = shoot.text.replace(stated, f"anamorphic_squeeze = 2.0\n{stated}")


def _bent(picture: np.ndarray, scale: float, k1: float) -> np.ndarray:
    """The picture through a further lens: enlarged, and displaced by the cube of the
    radius, which is 1 in the corner."""
    height, width = picture.shape[:2]
    middle = np.array([width - 1, height - 1]) / 2
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    place = np.stack([x, y], -1) - middle
    r2 = (place**2).sum(-1, keepdims=True) / (middle**2).sum()
    source = (place / scale * (1 + k1 * r2) + middle).astype(np.float32)
    return cv2.remap(
        picture, source[..., 0], source[..., 1], cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip


def _through(scale: float, k1: float, takes: slice) -> Callable[[WrongShoot], None]:
    return lambda shoot: shoot.repaint(
        shoot.all_takes()[takes], lambda picture: _bent(picture, scale, k1)
    )


def _shaken(shoot: WrongShoot) -> None:
    """The view in focus and stopped down, moved during its exposure."""
    streak = np.full((1, 7), 1 / 7, np.float32)
    shoot.repaint([3], lambda picture: cv2.filter2D(picture, -1, streak))


def _restated(key: str, change: Callable[[float], float]) -> Callable[..., None]:
    return lambda shoot: shoot.restate(key, change)


_LENSES = ("two lenses",)
WRONG_SHOOTS = (
    Wrong("pitch in inches", "inches of the pitch stated as millimetres",
          _restated("pitch_mm", lambda one: one / MILLIMETRES_PER_INCH),
          ("pitch_mm",)),
    Wrong("pitches swapped", "the pitch of dots stated of lines, and the reverse",
          _pitches_swapped, ("pitch_mm",)),
    Wrong("pitch of one axis", "rows half as far apart again as stated",
          _one_axis, ("pitch_mm",)),
    Wrong("distance in centimetres", "the chart's distance stated in centimetres",
          _restated("target_distance_mm", lambda one: one / 10),
          ("target_distance_mm",)),
    Wrong("distance in inches", "the chart's distance stated in inches",
          _restated("target_distance_mm", lambda one: one / MILLIMETRES_PER_INCH),
          ("target_distance_mm",)),
    Wrong("focal length of full frame", "the equivalent on a larger sensor stated",
          _restated("focal_length_mm", lambda one: 1.5 * one), ("focal_length_mm",)),
    Wrong("cropped mode", "the whole sensor stated of a cropped mode",
          _other_sensor(1.3), ("sensor_width_mm",)),
    Wrong("sensor in inches", "inches of the sensor stated as millimetres",
          _other_sensor(1 / MILLIMETRES_PER_INCH), ("sensor_width_mm",)),
    Wrong("sensor sides swapped", "width and height of the sensor swapped",
          _sensor_sides_swapped, ("sensor_width_mm",)),
    Wrong("mixed crops", "three views through a crop of the sensor",
          _cropped(0.8, slice(0, 3)), (*_LENSES, "sensor modes")),
    Wrong("zoom moved", "two views at another zoom setting",
          _cropped(0.93, slice(4, 6)), _LENSES),
    Wrong("mixed sizes", "three views scaled down",
          _resized(0.75, 0.75, slice(0, 3)), ("differ in size",)),
    Wrong("stretched", "a wide picture made of all photographs",
          _stretched, ("stretched",)),
    Wrong("rotated camera", "one photograph turned by a quarter",
          _turned, ("turned", "differ in size")),
    Wrong("stops swapped", "f-numbers of wide open and stopped down swapped",
          _stops_swapped, ("f/",)),
    Wrong("stop tenfold", "28 typed for 2.8", _stop_tenfold, ("f/",)),
    Wrong("focus in wrong order", "near, far, in written for in, near, far",
          _focus_in_wrong_order, ("near and far", "is blurred", "focus_distance_mm")),
    Wrong("files off by one", "every take with the file of the next",
          _files_off_by_one, ("are exchanged",)),
    Wrong("wrong chart", "the line grid stated as the dot grid",
          _lines_called_dots, ("no dot grid",)),
    Wrong("saved as JPEG", "sRGB JPEG files stated as linear", _as_jpeg,
          ("encoding",)),
    Wrong("log as linear", "log-coded files stated as linear", _log_coded,
          ("encoding",)),
    Wrong("copies saved again", "one exposure saved again under two more names",
          _copies_saved_again, ("one exposure",)),
    Wrong("moved chart", "the chart moved by a tenth before one view",
          _chart_moved, ("target_distance_mm",)),
    Wrong("pitch in centimetres", "the pitch stated in centimetres",
          _restated("pitch_mm", lambda one: one / 10), ("pitch_mm",)),
    Wrong("metres in one view", "the chart's distance of one view stated in metres",
          _metres_in_one_view, ("target_distance_mm",)),
    Wrong("stops of two views", "f-numbers of two views exchanged",
          _stops_of_two_views, ("f/", "is blurred")),
    Wrong("focus in feet", "marks of the feet scale stated as metres",
          _restated("focus_distance_mm", lambda one: one * _FEET_PER_METRE),
          ("focus_distance_mm",)),
    Wrong("one sensor mode", "one view through a crop of the sensor",
          _cropped(0.85, slice(6, 7)), (*_LENSES, "sensor mode")),
    Wrong("a column too many", "the dots' chart divided by one column too many",
          _column_too_many, ("pitch_mm",)),
    Wrong("squeeze of another lens", "a squeeze stated that the lens does not have",
          _squeezed, ("anamorphic_squeeze",)),
    Wrong("gamma as linear", "files of gamma 2.2 stated as linear",
          lambda shoot: shoot.repaint(
              shoot.all_takes(), lambda light: np.maximum(light, 0) ** (1 / 2.2)
          ), ("encoding",)),
    Wrong("wide adapter", "half of the views through a wide-angle adapter",
          _through(0.8, 0.08, slice(0, 4)), _LENSES),
    Wrong("corrected in camera", "distortion of half of the views corrected",
          _through(1.0, 0.03, slice(0, 4)), _LENSES),
    Wrong("shaken", "one view moved by seven pixels during its exposure",
          _shaken, ("is blurred", "moved")),
    Wrong("over-exposed", "all views exposed two stops too much",
          lambda shoot: shoot.repaint(shoot.all_takes(), lambda light: 4 * light),
          ("exposed", "clip")),
    Wrong("two views coded", "two views developed with gamma 2.2, the others not",
          lambda shoot: shoot.repaint(
              [3, 4], lambda light: np.maximum(light, 0) ** (1 / 2.2)
          ), ("encoding",)),
    Wrong("distance from the lens", "the tape held at the lens' front, 200 mm short",
          _restated("target_distance_mm", lambda one: one - 200),
          ("target_distance_mm",)),
)  # fmt: skip
