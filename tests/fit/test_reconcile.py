"""What marks say of what moved them: a wrong drag is undone, a true one stays."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoot import IMAGE_PX, MM_PER_PX, Camera, observations, take_of

from lensfit.fit.lens_state import left_px
from lensfit.fit.reconcile import reconciled
from lensfit.fit.sharing_pupils import fit_sharing_pupils
from lensfit.progress import silent

NOISE_PX, DRAG_PX, DOUBT_PX = 0.02, 0.6, 0.1
REACH_MM = 15.0
F_NUMBERS = (4.0, 8.0, 4.0)
CAMERA = Camera(k=(-0.05, 0.0))


def coma_px(points_mm, f_number):
    """Outwards, in proportion to the pupil: no map of one plane does that."""
    height = np.linalg.norm(points_mm, axis=-1, keepdims=True) / REACH_MM
    outward = points_mm / REACH_MM * height
    return DRAG_PX * (4.0 / f_number) ** 2 * outward


def barrel_px(points_mm, f_number):
    """Outwards, the same at every f-number: so does distortion."""
    del f_number
    height = np.linalg.norm(points_mm, axis=-1, keepdims=True) / REACH_MM
    return points_mm / REACH_MM * height**2


def photographed(dragged_px=0.0):
    """One chart three times, its centroids dragged by so much of `coma_px`."""
    takes = []
    for view, f_number in enumerate(F_NUMBERS):
        image = CAMERA.marks_mm(view)
        centroids = image + dragged_px * MM_PER_PX * coma_px(image, f_number)
        seen = observations(centroids, NOISE_PX, view)
        in_colour = np.repeat(seen.points_px[None], 3, 0)
        seen = replace(seen, channel_points_px=in_colour)
        takes.append(take_of(seen, f"view {view}", f_number=f_number))
    return takes


def moved(takes, by, errors, doubt_px=DOUBT_PX):
    """Marks less a drag of so much of `coma_px`, with doubts of these shapes."""
    found = []
    for take in takes:
        seen = take.observations
        middle = np.asarray(IMAGE_PX) / 2
        image = (seen.points_px - middle) * MM_PER_PX
        drag = by * coma_px(image, take.f_number)
        shapes = [doubt_px * MM_PER_PX * e(image, take.f_number) for e in errors]
        placed = replace(
            seen,
            points_px=seen.points_px - drag,
            channel_points_px=seen.channel_points_px - drag,
        )
        shared = np.repeat(np.array(shapes)[:, None], 3, 1)
        found.append(
            replace(take, observations=placed, chief_rays=True, shared_moves_mm=shared)
        )
    return found


def points(takes):
    return np.concatenate([take.observations.points_px for take in takes])


def doubt_px(takes):
    """Of a mark, all errors together."""
    each = [np.sqrt((t.shared_moves_mm[:, 1] ** 2).sum(0)) for t in takes]
    return float(np.sqrt(np.mean(np.concatenate(each) ** 2))) / MM_PER_PX


@pytest.fixture(scope="module")
def undragged():
    takes = photographed()
    return takes, fit_sharing_pupils(takes, silent)[0]


def test_a_drag_that_is_not_there_is_undone(undragged):
    """Though six times as large as it was said to be unsure."""
    takes, states = undragged
    wrong = moved(takes, 1.0, [coma_px])
    found = reconciled(states, wrong)
    before = np.abs(points(wrong) - points(takes)).max()
    after = np.abs(points(found) - points(takes)).max()
    assert before > 0.3
    assert after < 0.1 * before
    off = np.sqrt(np.mean(np.sum((points(found) - points(takes)) ** 2, -1)))
    assert off < 3 * doubt_px(found) < 0.1
    again, _ = fit_sharing_pupils(found, silent)
    assert left_px(again) < 1.05 * left_px(states)
    assert left_px(again) < left_px(fit_sharing_pupils(wrong, silent)[0])


def test_a_true_drag_stays():
    takes = photographed(1.0)
    states, _ = fit_sharing_pupils(takes, silent)
    right = moved(takes, 1.0, [coma_px])
    found = reconciled(states, right)
    assert np.abs(points(found) - points(right)).max() < 0.1 * DRAG_PX


def test_what_distortion_explains_as_well_is_as_unsure_as_it_was(undragged):
    takes, states = undragged
    same = moved(takes, 0.0, [barrel_px])
    found = reconciled(states, same)
    assert doubt_px(found) > 0.9 * doubt_px(same)
    moved_on = np.abs(points(found) - points(same)).max()
    assert moved_on < DOUBT_PX


def test_red_and_blue_go_along(undragged):
    takes, states = undragged
    found = reconciled(states, moved(takes, 1.0, [coma_px]))
    for take, seen in zip(found, takes, strict=True):
        channels = take.observations.channel_points_px
        assert np.abs(channels - seen.observations.channel_points_px).max() < 0.05


def test_marks_that_nothing_moved_stay(undragged):
    takes, states = undragged
    lines = replace(takes[1], chief_rays=True)
    found = reconciled(states, [*moved(takes[:1], 1.0, [coma_px]), lines, takes[2]])
    assert found[1] is lines
    assert found[2] is takes[2]
    assert reconciled(states, takes) == takes
