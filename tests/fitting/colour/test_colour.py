"""Lateral colour from marks: edge shifts, decentred colour, few terms, bad marks."""

from dataclasses import replace

import numpy as np
import pytest
from found_marks import found_marks

from lensfit.fitting.chart_view import View
from lensfit.fitting.colour.lateral_colour import Views, fit_colours
from lensfit.optics.lateral import ChannelShift, channel_from_green

IMAGE_PX, MM_PER_PX = np.array([1920, 1080]), 0.01
HALF_MM = IMAGE_PX * MM_PER_PX / 2
RADIUS_MM = float(np.hypot(*HALF_MM))
NOISE_PX = 0.2


def fit_colour(takes, principal_point_mm, reference_radius_mm):
    """Of one state by itself."""
    return fit_colours([Views(takes, principal_point_mm, reference_radius_mm)])[0]


def take_with(moved_px, *, noise_px=NOISE_PX, seed=0) -> View:
    """One photograph whose red and blue marks lie `moved_px(green)` off the green."""
    x, y = np.meshgrid(np.linspace(20, 1900, 44), np.linspace(20, 1060, 25))
    green = np.stack([x.ravel(), y.ravel()], 1)
    count = len(green)
    noise = np.random.default_rng(seed).normal(size=(2, count, 2)) * noise_px
    moved = moved_px(green - IMAGE_PX / 2)
    points = np.stack([green + moved + noise[0], green, green + moved + noise[1]])
    covariance = np.tile(np.eye(2) * noise_px**2 / 2, (count, 1, 1))
    observations = found_marks(
        green,
        (1920, 1080),
        covariance_px2=covariance,
        channel_points_px=points,
        channel_covariance_px2=np.stack([covariance] * 3),
        flux=np.ones((count, 3)),
        diameter_px=np.full(count, 9.0),
    )
    size = tuple((IMAGE_PX * MM_PER_PX).tolist())
    return View("a", "board", observations, (1.0, 1.0), None, 20.0, size)


def radial(coefficients, axis_px=(0.0, 0.0)):
    """Displacement along the radius from an axis, px; its radii in half diagonals."""

    def moved_px(from_centre_px):
        q = (from_centre_px - np.asarray(axis_px)) * MM_PER_PX / RADIUS_MM
        r2 = np.sum(q**2, -1, keepdims=True)
        return q * sum(c * r2**k for k, c in enumerate(coefficients))

    return moved_px


def modelled_px(colour, principal_point_mm, from_centre_px):
    """What the fitted channel does to green points, by the lens model itself."""
    shift = ChannelShift(
        np.asarray(colour.radial),
        np.asarray(colour.shift_mm),
        np.asarray(colour.valid_radius),
        np.resize(np.asarray(colour.strain or (0.0, 0.0)), 2),
        np.resize(np.asarray(colour.decentering or (0.0, 0.0)), 2),
    )
    green = from_centre_px * MM_PER_PX
    landed = [
        channel_from_green(g, shift, principal_point_mm, np.asarray(RADIUS_MM))
        for g in green
    ]
    return (np.asarray(landed) - green) / MM_PER_PX


RIM_PX = np.array([[-900.0, -500], [-900, 500], [900, -500], [900, 500], [0, 520]])


def test_a_centred_lens_needs_radial_terms_only():
    truth = radial([0.8, -1.5])
    colour = fit_colour((take_with(truth),), np.zeros(2), RADIUS_MM)["b"]
    assert np.count_nonzero(colour.radial) == 2
    assert colour.shift_mm == (0.0, 0.0)
    assert colour.strain == colour.decentering == ()
    deviation = np.sqrt(np.diag(colour.covariance))[-4:-2]
    scale = MM_PER_PX / RADIUS_MM
    error = np.array(colour.radial[:2]) - np.array([0.8, -1.5]) * scale
    assert (np.abs(error) < 4 * deviation).all()


@pytest.mark.parametrize("axis_px", [(190.0, 119.0), (-120.0, 60.0)])
def test_colour_about_another_axis_is_met_at_the_edge(axis_px):
    """The step near the edge that a radial formula about a wrong point undershoots."""
    truth = radial([0.1, -2.8], axis_px)
    colour = fit_colour((take_with(truth),), np.zeros(2), RADIUS_MM)["b"]
    modelled = modelled_px(colour, np.zeros(2), RIM_PX)
    assert np.abs(modelled - truth(RIM_PX)).max() < 0.1
    assert np.abs(truth(RIM_PX)).max() > 1.5


def test_a_tilted_element_is_met_and_its_azimuthal_mean_is_radial():
    tilt = np.array([[0.5, 0.2], [0.2, -0.5]])
    plain = radial([-0.6])

    def truth(from_centre_px):
        return plain(from_centre_px) + from_centre_px / 1100 @ tilt

    colour = fit_colour((take_with(truth),), np.zeros(2), RADIUS_MM)["r"]
    modelled = modelled_px(colour, np.zeros(2), RIM_PX)
    assert np.abs(modelled - truth(RIM_PX)).max() < 0.08
    value, deviation = colour.radial_px(np.array([1.0]), RADIUS_MM / MM_PER_PX)
    assert abs(value[0] + 0.6) < max(4 * deviation[0], 0.02)


def test_bad_marks_decide_nothing():
    truth = radial([-1.0])
    take = take_with(truth)
    take.observations.channel_points_px[2, ::25] += [6.0, -4.0]
    colour = fit_colour((take,), np.zeros(2), RADIUS_MM)["b"]
    modelled = modelled_px(colour, np.zeros(2), RIM_PX)
    assert np.abs(modelled - truth(RIM_PX)).max() < 0.1


def test_nothing_is_found_where_nothing_moves():
    take = take_with(lambda points: 0 * points)
    colour = fit_colour((take,), np.zeros(2), RADIUS_MM)
    for channel in colour.values():
        assert not any(channel.radial)
        assert channel.strain == channel.decentering == ()
        assert channel.strain == channel.decentering == ()


def test_stated_deviations_cover_the_truth():
    coefficients, covered = (1.0, -2.0), []
    expected = radial(coefficients)(RIM_PX)
    q = RIM_PX * MM_PER_PX / RADIUS_MM
    for seed in range(40):
        take = take_with(radial(coefficients), seed=seed)
        found = fit_colour((take,), np.zeros(2), RADIUS_MM)["r"]
        off = modelled_px(found, np.zeros(2), RIM_PX) - expected
        stated = found.deviations(q) * RADIUS_MM / MM_PER_PX
        covered.append(np.abs(off) <= stated)
    assert 0.58 < np.mean(covered) < 0.78


def test_what_moves_all_red_marks_alike_is_no_noise():
    """A common error of magnification stays, however many marks there are."""
    take = take_with(radial((1.0,)))
    green_mm = (take.observations.points_px - IMAGE_PX / 2) * MM_PER_PX
    shared = np.zeros((1, 3, len(green_mm), 2))
    shared[0, 0] = 4e-4 * green_mm
    colours = [
        fit_colour((one,), np.zeros(2), RADIUS_MM)
        for one in (take, replace(take, shared_moves_mm=shared))
    ]
    q = np.array([[0.5, 0.0]])
    red, moved = (c["r"].deviations(q)[0, 0] for c in colours)
    assert np.sqrt(moved**2 - red**2) == pytest.approx(4e-4 * 0.5, rel=1e-3)
    blue, still = (c["b"].deviations(q)[0, 0] for c in colours)
    assert still == pytest.approx(blue, rel=1e-9)


def clipped(take: View, share: float) -> View:
    """With the first marks of every hundred marked as clipped, and moved by a pixel."""
    o = take.observations
    which = np.arange(len(o)) % 100 < 100 * share
    places = o.channel_points_px + np.where(which, 1.0, 0.0)[None, :, None] * [[[1, 0]]]
    places[1] = o.channel_points_px[1]
    marked = replace(o, saturated=which, channel_points_px=places)
    return replace(take, observations=marked)


@pytest.mark.parametrize(("share", "moved_px"), [(0.6, 0.0), (0.99, 1.0)])
def test_clipped_marks_are_used_where_there_are_too_few_others(share, moved_px):
    truth = radial([0.8])
    take = clipped(take_with(truth), share)
    colour = fit_colour((take,), np.zeros(2), RADIUS_MM)["b"]
    off = modelled_px(colour, np.zeros(2), RIM_PX) - truth(RIM_PX)
    np.testing.assert_allclose(off.mean(0), [moved_px, 0], atol=0.1)


def test_chromatic_coma_measured_in_one_state_is_known_in_all():
    """Photographs at f/2.8 of two focus states carry the coma of red; at f/8, in one of
    them, there is none. How it goes over the frame is known, how much of it is not."""
    lateral = {"near": (1.0, -0.6), "far": (0.7, -0.2)}
    coma = radial((0.9,))

    def at_f2p8(name, seed):
        own = radial(lateral[name])
        take = take_with(lambda px: own(px) + coma(px), noise_px=0.02, seed=seed)
        green_px = take.observations.points_px - IMAGE_PX / 2
        moves = np.zeros((1, 3, len(green_px), 2))
        moves[0, [0, 2]] = 3 * coma(green_px) * MM_PER_PX
        return replace(
            take, name=name, f_number=2.8, chief_rays=True, shared_moves_mm=moves
        )

    sharp = take_with(radial(lateral["far"]), noise_px=0.02, seed=3)
    sharp = replace(sharp, name="f8", f_number=8.0)
    states = {"near": (at_f2p8("near", 1),), "far": (at_f2p8("far", 2), sharp)}
    views = [Views(takes, np.zeros(2), RADIUS_MM) for takes in states.values()]
    for name, found in zip(states, fit_colours(views), strict=True):
        truth = radial(lateral[name])(RIM_PX)
        for channel in ("r", "b"):
            off = modelled_px(found[channel], np.zeros(2), RIM_PX) - truth
            assert np.abs(off).max() < 0.02, (name, channel)
    alone = fit_colours(views[:1])[0]["r"]
    rim = RIM_PX[:1] * MM_PER_PX / RADIUS_MM
    assert alone.deviations(rim).max() > 20 * found["r"].deviations(rim).max()


STOPS = {2.8: 1.0, 5.6: 0.25}
"""f-numbers, and coma there of that at the widest."""


def biased(bias_px, seed, stops=tuple(STOPS), unit_px=3.0):
    """Takes whose red has a centroid bias by coma, and whose lens may have such coma of
    `unit_px` at the edge."""
    takes = []
    for k, f_number in enumerate(stops):
        coma = STOPS[f_number]
        truth = radial((1.0, -2.0))
        along = radial((1.0,))

        def moved(points, truth=truth, along=along, coma=coma):
            return truth(points) + bias_px * coma * along(points)

        take = take_with(moved, noise_px=0.05, seed=10 * seed + k)
        green = take.observations.points_px - IMAGE_PX / 2
        by_colour = np.zeros((1, 3, len(green), 2))
        by_colour[0, 0] = unit_px * coma * along(green) * MM_PER_PX
        takes.append(
            replace(
                take,
                name=str(k),
                f_number=f_number,
                chief_rays=True,
                shared_moves_mm=np.zeros((0, 3, len(green), 2)),
                colour_moves_mm=by_colour,
                colour_orders=(3,),
            )
        )
    return tuple(takes)


@pytest.mark.parametrize("bias_px", [0.0, 0.3])
def test_coma_of_colour_is_found_where_two_stops_tell_it(bias_px):
    expected, off, stated = radial((1.0, -2.0))(RIM_PX), [], []
    q = RIM_PX * MM_PER_PX / RADIUS_MM
    for seed in range(6):
        takes = biased(bias_px, seed)
        found = fit_colour(takes, np.zeros(2), RADIUS_MM)["r"]
        off.append(modelled_px(found, np.zeros(2), RIM_PX) - expected)
        stated.append(found.deviations(q) * RADIUS_MM / MM_PER_PX)
    assert np.abs(off).max() < 0.03
    assert np.mean(np.abs(off) <= np.array(stated)) > 0.5


def test_at_one_stop_colour_keeps_what_coma_may_be():
    """Nothing tells it from lateral colour: no share is more likely than another."""
    expected = radial((1.0, -2.0))(RIM_PX)
    takes = biased(0.3, 0, stops=(2.8,))
    found = fit_colour(takes, np.zeros(2), RADIUS_MM)["r"]
    off = modelled_px(found, np.zeros(2), RIM_PX) - expected
    assert np.abs(off).max() > 0.2


def stated_px(colour) -> float:
    """Standard deviation of places over the frame, rms, px."""
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 9), np.linspace(-0.45, 0.45, 9))
    known = colour.deviations(np.stack([x.ravel(), y.ravel()], 1))
    return float(np.sqrt(np.mean(np.sum(known**2, -1)))) * RADIUS_MM / MM_PER_PX


CUBIC_RMS = 0.3194
"""Of a displacement by q r^2 over the marks of `take_with`, q in half diagonals."""


def takes_apart(apart_px: float, count: int) -> tuple[View, ...]:
    """Photographs with smooth errors of their own of that rms."""
    own_px = apart_px * np.random.default_rng(4).normal(size=count)
    return tuple(
        take_with(radial([0.8, -1.5 + own / CUBIC_RMS]), noise_px=0.004, seed=k)
        for k, own in enumerate(own_px)
    )


@pytest.mark.parametrize("apart_px", [0.01, 0.03])
def test_colour_is_known_as_well_as_photographs_agree(apart_px):
    apart = fit_colour(takes_apart(apart_px, 6), np.zeros(2), RADIUS_MM)["b"]
    alike = fit_colour(takes_apart(0.0, 6), np.zeros(2), RADIUS_MM)["b"]
    assert 0.4 * apart_px < stated_px(apart) < 2 * apart_px
    assert stated_px(alike) < 0.002


def test_one_photograph_does_not_tell_its_own_errors():
    one = fit_colour(takes_apart(0.0, 1), np.zeros(2), RADIUS_MM)["b"]
    assert stated_px(one) == pytest.approx(0.003, rel=0.5)


def test_channels_that_are_copies_have_no_colour():
    take = take_with(radial([0.0]), noise_px=0.0)
    found = fit_colour((take,) * 2, np.zeros(2), RADIUS_MM)
    for colour in found.values():
        assert not colour.has_terms
        assert np.isfinite(colour.covariance).all()
