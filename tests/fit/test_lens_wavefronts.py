"""Why dots had no say in the blur, and what to state or to photograph."""

from types import SimpleNamespace

import numpy as np
import pytest

from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT
from lensfit.fit import lens_wavefronts
from lensfit.fit.lens_states import Fitted
from lensfit.fit.lens_wavefronts import fit_wavefronts
from lensfit.fit.wavefront.effort import Effort
from lensfit.progress import silent


def take(name="a", *, bright=True, family=POINT, f_number=2.0, hole_mm=0.5, **more):
    seen = SimpleNamespace(bright=bright, family=np.full(9, family))
    return SimpleNamespace(
        name=name,
        observations=seen,
        f_number=f_number,
        mark_diameter_mm=hole_mm,
        cutouts=more.get("cutouts"),
        target_distance_mm=None,
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
        (take(f_number=None), "state f_number of the dots"),
        (take(f_number=None, hole_mm=None), "state hole_diameter_mm and f_number"),
        (take(hole_mm=None, bright=False), None),
        (take(hole_mm=None, family=LINE_OF_CONSTANT_I), None),
    ],
)
def test_what_nobody_stated_of_the_dots_is_asked_for(one, said):
    found = fit_wavefronts([state(one)], silent, Effort.FASTEST, None)
    assert not found.fitted
    if said is None:
        assert not found.without
    else:
        assert found.without[50.0].startswith(said)


def test_takes_whose_dots_are_too_wide_are_named(monkeypatch):
    """The others are fitted."""
    names = ("near", "in focus", "far")
    takes = [take(name, cutouts=object()) for name in names]
    monkeypatch.setattr(
        lens_wavefronts,
        "hole_cells",
        lambda one: 3.8 + 0.4 * ("focus" not in one.take.name),
    )
    seen = []
    monkeypatch.setattr(
        lens_wavefronts, "fit_wavefront", lambda shown, *_, **__: seen.extend(shown)
    )
    found = fit_wavefronts([state(*takes)], silent, Effort.FASTEST, None)
    assert [one.take.name for one in seen] == ["in focus"]
    assert found.too_wide == {50.0: ["near", "far"]}
    (note,) = Fitted((state(*takes),), {}, too_wide=found.too_wide).notes
    assert note.startswith("the dots of near, far are over 8 pixels wide")
    assert not Fitted((state(*takes),), {}, too_wide={50.0: []}).notes
