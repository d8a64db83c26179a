"""A small scene with depth for Cycles: a checkered floor and wall, solids, lights.

Places are shares of the frame: x and y in halves of its width at the place's own
distance, distances in that of focus; sizes in halves of the frame's width at the focus
distance. Surfaces shine by themselves, as a sun would light them, so that every ray
that meets a point brings the same, and a picture needs no samples but those of the
lens.
"""

from typing import Any, NamedTuple

Thing = dict[str, Any]
_WOOD, _SLATE = [0.42, 0.3, 0.2], [0.12, 0.15, 0.19]
_RED, _CREAM = [0.6, 0.08, 0.06], [0.7, 0.65, 0.5]
_GREEN, _LEAF = [0.1, 0.4, 0.12], [0.35, 0.5, 0.1]
_BLUE, _SKY = [0.08, 0.15, 0.5], [0.4, 0.55, 0.7]
_WALL, _PLASTER = [0.3, 0.26, 0.28], [0.2, 0.2, 0.24]
_LAMP = [[10.0, 8.0, 5.0]]
_FLOOR, _BACK = 0.47, 3.0
"""Below the axis, in halves of the frame's width at the focus distance; the wall."""
_LAMPS = (
    (-0.85, -0.38), (-0.52, -0.2), (-0.26, -0.42), (0.04, -0.27),
    (0.12, -0.44), (0.45, -0.36), (0.8, -0.22),
)  # fmt: skip


class SceneScale(NamedTuple):
    """Millimetres of the scene's units.

    Attributes
    ----------
    focus_mm : Distance of the plane of focus from the entrance pupil.
    half_mm : Half the frame's width there.
    """

    focus_mm: float
    half_mm: float

    def solid(
        self,
        shape: str,
        at: tuple[float, float, float],
        size: float | tuple[float, float, float],
        colours: list[list[float]],
        check: float = 0.0,
        turn_deg: float = 0.0,
        *,
        shaded: bool = True,
    ) -> Thing:
        """A thing as `cycles_job` takes it."""
        x, y, z = at
        sizes = size if isinstance(size, tuple) else (size,) * 3
        return {
            "shape": shape,
            "at_mm": [x * z * self.half_mm, y * z * self.half_mm, z * self.focus_mm],
            "size_mm": [one * self.half_mm for one in sizes],
            "colours": colours,
            "check_mm": check * self.half_mm,
            "turn_deg": turn_deg,
            "shaded": shaded,
        }


def small_scene(scale: SceneScale) -> list[list[Thing]]:
    """Things of each layer, the nearest first; those of one layer hide nothing of each
    other.

    They stand before the focus, in it and behind it; a thin bar crosses the frame and a
    light's disc, and the floor goes through the focus.
    """
    solid, deep = scale.solid, scale.focus_mm / scale.half_mm
    floor_z = 0.5 * (0.35 + _BACK)
    lamps = [solid("ball", (x, y, 2.8), 0.035, _LAMP, shaded=False) for x, y in _LAMPS]
    floor = solid(
        "box",
        (0, (_FLOOR + 0.005) / floor_z, floor_z),
        (12.0, 0.01, (_BACK - 0.35) * deep),
        [_WOOD, _SLATE],
        0.25,
    )
    wall = solid("box", (0, 0, _BACK), (12.0, 8.0, 0.02), [_WALL, _PLASTER], 0.4)
    return [
        [solid("bar", (0.08, 0, 0.5), (0.012, 1.5, 0.012), [_GREEN], 0.0, 14.0)],
        [solid("ball", (0.62, 0.3, 0.6), 0.2, [_BLUE, _SKY], 0.06)],
        [solid("ball", (-0.38, 0.235, 1.0), 0.46, [_RED, _CREAM], 0.07)],
        [solid("box", (0.3, 0.12, 1.45), (0.5, 0.5, 0.5), [_LEAF, _GREEN], 0.09)],
        [solid("ball", (-0.62, 0.02, 2.2), 0.6, [_SKY, _BLUE], 0.15)],
        lamps,
        [floor],
        [wall],
    ]
