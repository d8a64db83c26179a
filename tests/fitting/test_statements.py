"""What is stated enters as residuals in widths; what is wrong does not bend a lens."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoot import FRONTAL, Camera, shoot

from lensfit.fitting.chart_view import Widths
from lensfit.fitting.chief_ray import fit_chief_ray
from lensfit.fitting.geometric_start import facts_of
from lensfit.fitting.lens_states import fit
from lensfit.fitting.parameters import Layout
from lensfit.fitting.start_poses import stated_scale
from lensfit.fitting.statements import statements_of
from lensfit.fitting.usual_lens import magnification_at

CAMERA = Camera(30.6, (0.0, 0.0), rotations=FRONTAL)
PUPIL_MM = 45.0


def takes_at(distances_mm, **changes):
    views = shoot(CAMERA, 0.02, 5)[: len(distances_mm)]
    return [
        replace(view, target_distance_mm=mm, **changes)
        for view, mm in zip(views, distances_mm, strict=True)
    ]


@pytest.fixture
def facts():
    return facts_of(takes_at((950.0, 990.0, 990.0), f_number=2.0))


def test_residuals_are_fitted_less_stated_over_width(facts):
    layout, unit_mm, depth_mm = Layout(), 31.0, np.array([900.0, 940.0, 941.0])
    statements = statements_of(facts, layout, unit_mm, depth_mm)
    rng = np.random.default_rng(0)
    parameters = rng.normal(0, 0.01, layout.size(3))
    c_mm = unit_mm * np.exp(parameters[layout.blocks["focal_length"]][0])
    offset_mm = unit_mm * parameters[layout.blocks["pupil_offset"]][0]
    shift_mm = unit_mm * parameters[layout.blocks["pupil_shift"]][0]
    fitted_mm = depth_mm * (1 + parameters[layout.local_indices("pose", 3)[:, 5]])
    width_mm = [Widths().of_distance_mm(mm) for mm in facts.target_distance_mm]
    pupil, pupil_shift = facts.perspective
    # Two views share one measured distance, and its error.
    wanted = [
        np.log(c_mm / facts.principal_distance_mm) / facts.focal_length_width,
        (offset_mm - pupil.offset_mm) / pupil.standard_deviation_mm,
        (shift_mm - pupil_shift.shift_mm) / pupil_shift.standard_deviation_mm,
        *(
            (offset_mm + fitted_mm - facts.target_distance_mm)
            / width_mm
            / np.sqrt([1.0, 2.0, 2.0])
        ),
    ]
    np.testing.assert_allclose(statements.residuals(parameters), wanted, rtol=1e-10)
    squares = parameters @ statements.matrix @ parameters
    squares += statements.constant - 2 * statements.vector @ parameters
    np.testing.assert_allclose(squares, np.sum(np.square(wanted)), rtol=1e-10)


def test_the_table_has_every_number_as_it_was_stated(facts):
    layout = Layout()
    statements = statements_of(facts, layout, 31.0, np.array([900.0, 940.0, 941.0]))
    table = statements.table(np.zeros(layout.size(3)))
    stated = {(one.quantity, one.where): one for one in table}
    assert stated["focal_length", ""].stated == 30.0
    assert stated["focal_length", ""].fitted == pytest.approx(
        31.0 / (1 + facts.magnification)
    )
    assert stated["target_distance", facts.names[0]].stated == 950.0
    assert stated["target_distance", facts.names[0]].fitted == pytest.approx(900.0)
    assert stated["target_distance", facts.names[2]].fitted == pytest.approx(941.0)
    assert stated["target_distance", facts.names[2]].contradicts


def test_a_thin_lens_magnifies_as_newton_has_it():
    focal_mm, m = 50.0, 0.04
    assert magnification_at(focal_mm, focal_mm * (2 + m + 1 / m)) == pytest.approx(m)
    assert magnification_at(focal_mm, np.inf) == 0.0


def test_scale_is_the_compromise_of_all_that_is_stated():
    """With the pupil known, the distance outweighs a focal length: 5 mm of 900 against
    three percent."""
    facts = facts_of(takes_at((945.0,)))
    sure = facts.perspective.pupil._replace(
        offset_mm=PUPIL_MM, standard_deviation_mm=0.1
    )
    known = replace(facts, perspective=facts.perspective._replace(pupil=sure))
    found = stated_scale(known, 30.0, np.array([850.0]))
    assert found.ratio == pytest.approx(900.0 / 850.0, rel=0.003)
    # Unknown, it gives way, and the focal length is what was stated.
    vague = facts.perspective.pupil._replace(standard_deviation_mm=1e4)
    unknown = replace(facts, perspective=facts.perspective._replace(pupil=vague))
    found = stated_scale(unknown, 30.0, np.array([850.0]))
    assert found.ratio == pytest.approx(1 + facts.magnification, rel=1e-3)


def test_one_wrong_distance_is_named_and_moves_nothing():
    right = [PUPIL_MM + CAMERA.distance_mm + 40.0 * k for k in range(3)]
    wrong = [right[0], right[1] + 150.0, right[2]]
    good, bad = (fit_chief_ray(takes_at(one)) for one in (right, wrong))
    named = [one.where for one in bad.statements if one.contradicts]
    assert named == [bad.takes[1].name]
    assert not any(one.contradicts for one in good.statements)
    for block in ("focal_length", "pupil_offset"):
        where = good.adjustment.layout.blocks[block]
        moved, still = (
            float(one.adjustment.parameters[where][0])
            * float(one.adjustment.frame.stated_focal_length_mm)
            for one in (bad, good)
        )
        # A shared error of all distances would be told from neither.
        assert abs(moved - still) < 15.0


def test_a_contradiction_is_a_sentence_of_the_report():
    right = [PUPIL_MM + CAMERA.distance_mm + 40.0 * k for k in range(3)]
    found = fit(takes_at([right[0], right[1], right[2] + 200.0], f_number=8.0))
    (sentence, *_) = found.notes
    assert found.states[0].geometry.takes[2].name in sentence
    assert f"{right[2] + 200:g} mm" in sentence
