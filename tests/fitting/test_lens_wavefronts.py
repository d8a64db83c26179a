"""Why dots had no say in the blur, and what to state or to photograph."""

from types import SimpleNamespace

import numpy as np
import pytest

from lensfit.fitting import lens_wavefronts
from lensfit.fitting.lens_states import FittedLens
from lensfit.fitting.lens_wavefronts import fit_wavefronts
from lensfit.fitting.wavefront.effort import Effort
from lensfit.progress import silent


def take(name="a", *, bright=True, diameter_px=4.0, f_number=2.0, hole_mm=0.5, **more):
    seen = SimpleNamespace(
        bright=bright,
        diameter_px=np.full(9, diameter_px),
        are_corners=more.get("are_corners", False),
        are_lines=more.get("are_lines", False),
        are_edges=more.get("are_corners", False) or more.get("are_lines", False),
        points_px=more.get("points_px"),
        image_size_px=(640, 480),
    )
    return SimpleNamespace(
        name=name,
        target=more.get("target", "dots"),
        observations=seen,
        f_number=f_number,
        mark_diameter_mm=hole_mm,
        dot_images=more.get("dot_images"),
        target_distance_mm=None,
        focus_distance_mm=more.get("focus_mm", 2000.0),
    )


def state(*takes):
    return SimpleNamespace(
        focal_length_mm=50.0,
        focus_distance_mm=2000.0,
        colour={},
        geometry=SimpleNamespace(takes=takes, statements=()),
        distortion=None,
        fall_off=(),
        pupil=SimpleNamespace(offset_mm=0.0),
    )


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (take(hole_mm=None), "state hole_diameter_mm of the dots"),
        (take(f_number=None, hole_mm=None), "state hole_diameter_mm of the dots"),
        (take(hole_mm=None, bright=False), "state hole_diameter_mm of the dots"),
        (take(hole_mm=None, diameter_px=np.nan), None),
        (
            take(hole_mm=None, diameter_px=np.nan, are_lines=True),
            "state line_width_mm of the lines",
        ),
    ],
)
def test_what_nobody_stated_of_the_dots_is_asked_for(one, said):
    found = fit_wavefronts([state(one)], silent, Effort.FASTEST, None)
    assert not found.fitted
    if said is None:
        assert not found.without
    else:
        assert found.without[50.0].startswith(said)


def noted(shown, seen):
    """In place of a fit."""
    seen.extend(shown)
    return SimpleNamespace(dot_data=SimpleNamespace(of_one_setting=False))


def fitted_of(takes, wide_cells, monkeypatch):
    """What was made of takes with dots of these radii, and which were fitted."""
    monkeypatch.setattr(
        lens_wavefronts,
        "dot_aperture_radius_cells",
        lambda one: wide_cells[one.take.name],
    )
    seen = []
    monkeypatch.setattr(
        lens_wavefronts, "fit_wavefront", lambda shown, *_, **__: noted(shown, seen)
    )
    monkeypatch.setattr(lens_wavefronts, "_with_unfitted_lines", lambda fit, *_: fit)
    found = fit_wavefronts([state(*takes)], silent, Effort.FASTEST, None)
    return found, [one.take.name for one in seen]


def test_a_chart_of_small_holes_is_fitted_wherever_it_is_seen(monkeypatch):
    """Holes that are small in the coarse cells of a wide blur are broad in focus."""
    wide_cells = {"in focus": 2.4, "far": 0.8, "near": 1.1}
    takes = [take(name, dot_images=object()) for name in wide_cells]
    found, seen = fitted_of(takes, wide_cells, monkeypatch)
    assert seen == ["in focus", "far", "near"]
    assert found.takes_with_wide_dots == {50.0: []}


def test_takes_of_wider_dots_than_another_chart_has_are_named(monkeypatch):
    """The others are fitted."""
    wide_cells = {"near": 1.2, "in focus": 0.8, "far": 1.2}
    takes = [
        take(name, dot_images=object(), target="small" if cells < 1 else "wide")
        for name, cells in wide_cells.items()
    ]
    found, seen = fitted_of(takes, wide_cells, monkeypatch)
    assert seen == ["in focus"]
    assert found.takes_with_wide_dots == {50.0: ["near", "far"]}
    (note,) = FittedLens(
        (state(*takes),), {}, takes_with_wide_dots=found.takes_with_wide_dots
    ).notes
    assert note.endswith("smaller dots than those of near, far, which were left out")
    assert not FittedLens((state(*takes),), {}, takes_with_wide_dots={50.0: []}).notes


@pytest.mark.parametrize(
    "other", [{"f_number": 4.0}, {"focus_mm": 1500.0}], ids=["stop", "focus"]
)
@pytest.mark.parametrize("bright", [True, False], ids=["bright", "dark"])
def test_wide_dots_of_two_settings_are_fitted(bright, other, monkeypatch):
    wide_cells = {"one": 5.0, "other": 8.0}
    takes = [take("one", bright=bright, dot_images=object())]
    takes += [take("other", bright=bright, dot_images=object(), **other)]
    found, seen = fitted_of(takes, wide_cells, monkeypatch)
    assert seen == ["one", "other"]
    assert not found.without


def test_wide_dots_of_one_setting_are_fitted(monkeypatch):
    takes = [take("one", dot_images=object()), take("other", dot_images=object())]
    _, seen = fitted_of(takes, {"one": 5.0, "other": 5.0}, monkeypatch)
    assert seen == ["one", "other"]


def test_dots_that_leave_no_rim_on_their_picture_are_too_large(monkeypatch):
    found, seen = fitted_of(
        [take("one", dot_images=object())], {"one": 9.5}, monkeypatch
    )
    assert not seen
    assert "the dots themselves are too large" in found.without[50.0]


@pytest.mark.parametrize(
    ("stated", "used"), [((None, None), (5.6, 5.6)), ((2.8, None), (2.8,))]
)
def test_an_f_number_that_no_take_states_is_the_unit(stated, used, monkeypatch):
    """One beside takes that state theirs is another one, and unknown."""
    takes = [
        take(name, f_number=number, dot_images=object())
        for name, number in zip("ab", stated, strict=True)
    ]
    seen = []
    monkeypatch.setattr(lens_wavefronts, "dot_data_of", lambda *_: None)
    monkeypatch.setattr(lens_wavefronts, "sharp_f_number", lambda _: 5.6)
    monkeypatch.setattr(lens_wavefronts, "dot_aperture_radius_cells", lambda _: 0.5)
    monkeypatch.setattr(
        lens_wavefronts, "fit_wavefront", lambda shown, *_, **__: noted(shown, seen)
    )
    fit_wavefronts([state(*takes)], silent, Effort.FASTEST, None)
    assert tuple(one.f_number for one in seen) == used


def test_no_effort_leaves_the_blur_out():
    found = fit_wavefronts([state(take("one"))], silent, Effort.NONE, None)
    assert found.without == {50.0: "effort none leaves it out"}


def test_small_dark_dots_of_one_setting_are_fitted(monkeypatch):
    takes = [take("one", bright=False, dot_images=object())]
    _, seen = fitted_of(takes, {"one": 0.5}, monkeypatch)
    assert seen == ["one"]


def corners(name, **more):
    return take(name, hole_mm=None, dot_images=object(), are_corners=True, **more)


def test_checker_corners_are_fitted_where_there_are_no_small_holes(monkeypatch):
    """And are never called dots that are too wide."""
    takes = [corners("board"), take("broad", dot_images=object())]
    found, seen = fitted_of(takes, {"board": 0.0, "broad": 5.0}, monkeypatch)
    assert seen == ["broad", "board"]
    takes = [corners("board"), take("holes", dot_images=object())]
    found, seen = fitted_of(takes, {"board": 0.0, "holes": 0.5}, monkeypatch)
    assert seen == ["holes"]
    assert found.takes_with_wide_dots == {50.0: []}


def lines(name, **more):
    more = {"hole_mm": 0.2, "dot_images": object(), "are_lines": True} | more
    return take(name, diameter_px=np.nan, **more)


def test_lines_are_fitted_where_there_is_nothing_else(monkeypatch):
    shot = [lines("near", focus_mm=1500.0), lines("far", focus_mm=3000.0)]
    found, seen = fitted_of(shot, {}, monkeypatch)
    assert seen == ["near", "far"]
    for other in (corners("board"), take("broad", dot_images=object())):
        found, seen = fitted_of([*shot, other], {"broad": 5.0}, monkeypatch)
        assert seen == [other.name]
        assert found.takes_with_wide_dots[50.0] == []


def test_lines_are_not_fitted_in_place_of_dots_of_unknown_size(monkeypatch):
    shot = [lines("near", focus_mm=1500.0), lines("far"), take("dots", hole_mm=None)]
    found, seen = fitted_of(shot, {}, monkeypatch)
    assert not seen
    assert found.without[50.0].startswith("state hole_diameter_mm of the dots")


def test_lines_of_one_setting_are_not_fitted(monkeypatch):
    found, seen = fitted_of([lines("one"), lines("two")], {}, monkeypatch)
    assert not seen
    assert "photograph them at two f-numbers" in found.without[50.0]


def test_of_many_photographs_of_one_setting_the_least_alike_are_fitted(monkeypatch):
    """Two places, photographed twelve times and once: the one is among the eight."""
    rng = np.random.default_rng(5)
    takes = []
    for k in range(13):
        place = (600.0, 450.0) if k == 7 else (200.0, 200.0)
        points = place + rng.normal(0, 15.0, (9, 2))
        takes.append(corners(str(k), points_px=points))
    _, seen = fitted_of(takes, {}, monkeypatch)
    assert len(seen) == 8
    assert "7" in seen
    assert seen == sorted(seen, key=int)
