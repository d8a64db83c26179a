"""The point-spread function of a lens: what physics says of every one of them."""

import warnings
from dataclasses import replace

import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
from preset_makers import make_blur, make_entry, make_preset

from lensfit.errors import LensfitError
from lensfit.lens import Channel, Lens
from lensfit.optics.lateral import channel_from_green
from lensfit.optics.paraxial import FirstOrder, defocus_mm
from lensfit.preset.blocks import (
    Blur,
    ChannelShift,
    Distortion,
    LateralColour,
    Projection,
    Pupil,
)
from lensfit.preset.entry import Entry
from lensfit.psf.lens_blur import LensBlur
from lensfit.psf.lens_psf import _patches_with_rays, _pencils, _ray_turns

SIZE = 64
FOCUS_MM = 2000.0
AXIS = (0.0, 0.0)
FIELD = (7.0, 4.0)
CENTRED = {
    "projection": Projection(51.3, (0.0, 0.0), 60.0),
    "distortion": Distortion("rectilinear", 15.6, 1.02, (-0.8, -0.6, 0.8, 0.6)),
    "lateral_colour": None,
}
IDEAL = make_blur(
    aberrations=(),
    pupil=Pupil(),
    pupil_magnification=1.0,
    focus_offset_mm=0.0,
    chief_bend=0.0,
    stops=(),
)


def entry_of(blur: Blur | None, **changes) -> Entry:
    """Centred, undistorted, colourless."""
    return make_entry(**(CENTRED | {"blur": blur} | changes))


def lens_of(blur: Blur | None, f_number: float = 1.4, **changes) -> Lens:
    return make_preset(entry_of(blur, **changes)).at(50.0, f_number)


def psf(
    lens: Lens, point, distance_mm, pitch=0.006, channel: Channel = "g", **options
) -> np.ndarray:
    options = {"pixel_pitch_mm": pitch, "size_px": SIZE} | options
    return np.asarray(lens.psf(point, distance_mm, channel, **options))


def centroid_px(patch: np.ndarray) -> np.ndarray:
    """x, y from the middle of the array."""
    x = np.arange(len(patch)) + 0.5 - len(patch) / 2
    return np.array([patch.sum(0) @ x, patch.sum(1) @ x])


def second_moment_px2(patch: np.ndarray) -> float:
    """Of x and y together, without what the pixels themselves add."""
    x = np.arange(len(patch)) + 0.5 - len(patch) / 2
    centre = centroid_px(patch)
    spread = patch.sum(0) @ (x - centre[0]) ** 2 + patch.sum(1) @ (x - centre[1]) ** 2
    return float(spread) - 2 / 12


def far_from(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def moved_sensor(lens: Lens, by_mm: float) -> Lens:
    """The same lens with its sensor further back."""
    assert lens.blur is not None
    blur: LensBlur = lens.blur
    return replace(lens, blur=replace(blur, defocus_mm=blur.defocus_mm + by_mm))


@pytest.mark.parametrize(
    "blur", [None, IDEAL, make_blur()], ids=["none", "ideal", "real"]
)
@pytest.mark.parametrize("point", [AXIS, FIELD, (12.4, -9.3)])
@pytest.mark.parametrize("distance_mm", [1500.0, FOCUS_MM, np.inf])
def test_light_is_whole_and_positive(blur, point, distance_mm):
    """On the axis and in the corner, in focus and at infinity."""
    for f_number in (1.4, 8.0):
        patch = psf(lens_of(blur, f_number), point, distance_mm, tolerance=0.1)
        assert patch.shape == (SIZE, SIZE)
        np.testing.assert_allclose(patch.sum(), 1.0, rtol=1e-12)
        assert patch.min() >= 0


def test_a_perfect_lens_in_focus_shows_diffraction_and_pixels():
    lens = lens_of(IDEAL, 8.0)
    working = 8.0 * (1 + _magnification(lens))
    sigma_um = 0.42 * 0.538 * working
    fine = psf(lens, AXIS, FOCUS_MM, 0.0005)
    measured_um = np.sqrt(second_moment_px2(fine) / 2) * 0.5
    np.testing.assert_allclose(measured_um, sigma_um, rtol=0.01)
    coarse = psf(lens, AXIS, FOCUS_MM, 0.05, size_px=5)
    assert coarse[2, 2] > 0.999


def _magnification(lens: Lens) -> float:
    """Image over object size at the focus distance, thin lens."""
    assert lens.blur is not None
    first = lens.blur.first_order
    f = float(first.focal_length_mm)
    return f / (FOCUS_MM - float(first.entrance_pupil_offset_mm) - f)


@pytest.mark.parametrize("f_number", [1.4, 8.0])
def test_a_disc_of_defocus_is_the_exact_cone(f_number: float):
    """Its radius is dz tan; at f/8 that is dz sine."""
    dz = 0.35 * f_number
    lens = moved_sensor(lens_of(IDEAL, f_number), dz)
    sine = 1 / (2 * f_number * (1 + _magnification(lens)))
    pitch = 0.006
    patch = psf(lens, AXIS, FOCUS_MM, pitch, tolerance=0.004)
    radius = dz * sine / np.sqrt(1 - sine**2)
    inside = _even_share(dz, radius, pitch)
    np.testing.assert_allclose(far_from(patch, inside), 0.0, atol=0.03)
    for wrong in (0.98, 1.02):
        assert far_from(patch, _even_share(dz, wrong * radius, pitch)) > 0.06
    ratio = second_moment_px2(patch) / second_moment_px2(inside)
    assert np.sqrt(ratio) == pytest.approx(1.0, abs=0.005)  # of the diameter
    if f_number == 8.0:
        assert radius == pytest.approx(dz * sine, rel=0.01)


def _even_share(dz: float, radius_mm: float, pitch: float) -> np.ndarray:
    """A cone of even light in direction cosines, cut at `radius_mm`, on pixels."""
    fine = 16
    x = ((np.arange(SIZE * fine) + 0.5) / fine - SIZE / 2) * pitch
    r = np.hypot(x[:, None], x)
    # r = dz p / sqrt(1 - p^2); light is even in p: dP/dA = 1 / (1 + r^2/dz^2)^2.
    light = np.where(r < radius_mm, (1 + (r / dz) ** 2) ** -2, 0.0)
    light = light.reshape(SIZE, fine, SIZE, fine).sum((1, 3))
    return light / light.sum()


def test_the_size_of_blur_follows_the_f_number():
    """Second moment over N^-2 is one number; diffraction is taken out."""
    scaled = []
    for f_number in (2.8, 5.6, 11.0):
        lens = lens_of(IDEAL, f_number)
        airy = (
            2 * (0.42 * 0.538e-3 * f_number * (1 + _magnification(lens)) / 0.006) ** 2
        )
        moment = second_moment_px2(psf(lens, AXIS, 3000.0, tolerance=0.003))
        scaled.append((moment - airy) * f_number**2)
    np.testing.assert_allclose(scaled[1:], scaled[0], rtol=0.02)


def test_an_object_at_the_focus_distance_is_sharpest():
    for point in (AXIS, FIELD):
        for f_number in (1.4, 4.0):
            lens = lens_of(IDEAL, f_number)
            near, sharp, far = (
                second_moment_px2(psf(lens, point, d, tolerance=0.02))
                for d in (1970.0, FOCUS_MM, 2030.0)
            )
            assert sharp < min(near, far)


def test_a_centred_lens_has_mirror_symmetry():
    lens = lens_of(
        make_blur(pupil=msgspec.structs.replace(make_blur().pupil, blades=0))
    )
    here = psf(lens, FIELD, 2600.0)
    across = psf(lens, (-FIELD[0], FIELD[1]), 2600.0)
    upside_down = psf(lens, (FIELD[0], -FIELD[1]), 2600.0)
    assert far_from(across[:, ::-1], here) < 0.02
    assert far_from(upside_down[::-1], here) < 0.02
    assert far_from(across, here) > 0.1


def test_channels_lie_apart_by_the_lateral_colour():
    shifted = LateralColour(
        ChannelShift((1e-3, -3e-4), (0.0, 0.0), 1.02),
        ChannelShift((-2e-3,), (0.001, 0.0), 1.02),
    )
    lens = lens_of(IDEAL, 4.0, lateral_colour=shifted)
    assert lens.lateral_colour is not None
    assert lens.blur is not None
    red, blue = (
        channel_from_green(jnp.asarray(FIELD), shift, jnp.zeros(2), jnp.asarray(15.6))
        - jnp.asarray(FIELD)
        for shift in lens.lateral_colour
    )
    pitch = 0.0015
    channels: tuple[Channel, ...] = ("r", "g", "b")
    for channel in channels:
        place = centroid_px(psf(lens, FIELD, FOCUS_MM, pitch, channel)) * pitch
        own = {"r": red, "g": jnp.zeros(2), "b": blue}[channel]
        np.testing.assert_allclose(place, own, atol=2e-5)
    assert min(np.hypot(*red), np.hypot(*blue)) > 4e-3


def test_channels_can_be_had_without_where_they_land():
    """As the renderer wants them, whose maps move the channels already."""
    away = ChannelShift((2e-3,), (0.002, -0.001), 1.02)
    lens = lens_of(IDEAL, 4.0, lateral_colour=LateralColour(away, away))
    pitch_mm = 0.0015
    options = {"pixel_pitch_mm": pitch_mm, "size_px": 65}
    with_it, without = (
        lens.psfs(np.array([FIELD]), FOCUS_MM, **options, with_lateral_colour=flag)[0]
        for flag in (True, False)
    )
    for own in np.asarray(without):
        np.testing.assert_allclose(centroid_px(own) * pitch_mm, 0, atol=2e-5)
    assert np.hypot(*centroid_px(np.asarray(with_it[0]))) * pitch_mm > 2e-3


@pytest.mark.parametrize("blur", [IDEAL, make_blur()], ids=["ideal", "real"])
def test_stopping_down_never_enlarges_a_disc(blur: Blur):
    moments = [
        second_moment_px2(psf(lens_of(blur, n), FIELD, 3500.0, 0.008, tolerance=0.02))
        for n in (1.4, 2.0, 2.8, 4.0, 5.6)
    ]
    assert np.all(np.diff(moments) < 0)


@pytest.mark.parametrize("point", [AXIS, FIELD])
@pytest.mark.parametrize("distance_mm", [1950.0, 2050.0])
def test_a_little_depth_is_a_little_of_sensor(point, distance_mm: float):
    """At f/4; the cone of a moved sensor is steeper at a fast lens' rim, by p^2 / 2."""
    lens = lens_of(make_blur(), 4.0)
    assert lens.blur is not None
    first: FirstOrder = lens.blur.first_order
    dz = float(defocus_mm(first, jnp.asarray(FOCUS_MM), jnp.asarray(distance_mm)))
    assert abs(dz) > 0.03
    by_depth = psf(lens, point, distance_mm, 0.001, tolerance=0.003)
    by_sensor = psf(moved_sensor(lens, dz), point, FOCUS_MM, 0.001, tolerance=0.003)
    unmoved = psf(lens, point, FOCUS_MM, 0.001, tolerance=0.003)
    assert far_from(by_depth, by_sensor) < 0.05
    assert far_from(unmoved, by_sensor) > 0.3


@pytest.mark.parametrize("blur", [IDEAL, make_blur()], ids=["disc", "aberrated"])
def test_the_error_is_what_was_asked_for(blur: Blur):
    """At blurs from a few pixels to forty."""
    lens = lens_of(blur, 1.4)
    for distance_mm, pitch in ((FOCUS_MM, 0.006), (2100.0, 0.006), (2500.0, 0.004)):
        truth = psf(lens, FIELD, distance_mm, pitch, tolerance=5e-4)
        for tolerance in (0.04, 0.01):
            found = psf(lens, FIELD, distance_mm, pitch, tolerance=tolerance)
            assert far_from(found, truth) < 1.3 * tolerance


def test_many_points_are_the_same_as_each_alone():
    lens = lens_of(make_blur(), 2.0, lateral_colour=make_entry().lateral_colour)
    points, distances = np.array([AXIS, FIELD]), np.array([1800.0, np.inf])
    options = {"pixel_pitch_mm": (0.006, 0.012), "size_px": 24, "tolerance": 0.05}
    many = np.asarray(lens.psfs(points, distances, ("g", "r"), **options))
    assert many.shape == (2, 2, 24, 24)
    for i, (point, distance) in enumerate(zip(points, distances, strict=True)):
        for j, channel in enumerate(("g", "r")):
            alone = lens.psf(point, distance, channel, **options)
            np.testing.assert_allclose(many[i, j], alone, atol=1e-12)


def programs() -> tuple[int, int, int]:
    """How many were compiled: of points, of rays, of pixels."""
    points, rays, pixels = (
        made._cache_size()  # pyright: ignore[reportAttributeAccessIssue]
        for made in (_pencils, _ray_turns, _patches_with_rays)
    )
    return points, rays, pixels


def test_one_program_serves_every_state():
    preset = make_preset(entry_of(make_blur()), entry_of(
        make_blur(focus_offset_mm=0.02), focus_distance_mm=1000.0,
    ))  # fmt: skip
    psf(preset.at(50.0, 2.8, 1500.0), AXIS, 1700.0, tolerance=0.1)
    before = programs()
    for f_number, focus_mm, distance in ((4.0, 1200.0, 900.0), (5.6, 1900.0, np.inf)):
        lens = preset.at(50.0, f_number, focus_mm)
        psf(lens, FIELD, distance, 0.004, "b", tolerance=0.05)
    assert programs() == before


def test_arrays_of_another_size_compile_no_rays():
    lens = lens_of(make_blur(), 2.8)
    options = {"pixel_pitch_mm": 0.004, "tolerance": 0.1}
    lens.psf(FIELD, 2500.0, "g", size_px=24, **options)
    before = programs()
    for size_px in (40, 90, 170):
        lens.psf(FIELD, 2500.0, "g", size_px=size_px, **options)
    after = programs()
    assert after[:2] == before[:2]
    assert after[2] <= before[2] + 3


def test_what_is_asked_for_together_changes_nothing():
    """More points than a program takes at a time, of blurs that need few and many
    rays, are those of each point alone."""
    lens = lens_of(make_blur(), 2.8)
    points = np.linspace((-8.0, -5.0), FIELD, 27)
    distances = np.geomspace(1200.0, 9000.0, 27)
    options = {"pixel_pitch_mm": 0.01, "size_px": 48, "tolerance": 0.05}
    many = np.asarray(lens.psfs(points, distances, ("g",), **options))[:, 0]
    for i in (0, 11, 12, 26):
        one = np.asarray(lens.psf(points[i], float(distances[i]), "g", **options))
        assert np.abs(many[i] - one).max() < 1e-7


def test_blades_show_only_when_stopped_down():
    """A heptagon's blur has more light beyond the round disc of its area."""
    blur = make_blur(aberrations=(), focus_offset_mm=0.0)
    straight = msgspec.structs.replace(blur.pupil, rims=(), blade_curvature=0.0)
    bladed = msgspec.structs.replace(blur, pupil=straight)
    rounded = msgspec.structs.replace(bladed, round_f_number=22.0)
    for f_number, differs in ((1.4, False), (1.42, False), (2.8, True)):
        one, other = (
            psf(lens_of(b, f_number), AXIS, 2500.0, 0.004 / f_number, tolerance=0.02)
            for b in (bladed, rounded)
        )
        assert (far_from(one, other) > 0.1) is differs


def test_a_lens_without_blur_is_perfect_and_says_so():
    lens = lens_of(None, 4.0)
    assert lens.blur is None
    assert any("blur was not measured" in note for note in lens.notes)
    patch = psf(lens, AXIS, 3000.0)
    assert far_from(patch, psf(lens_of(IDEAL, 4.0), AXIS, 3000.0)) < 0.01
    # a flat pupil: the same disc everywhere
    assert far_from(psf(lens, FIELD, 3000.0), patch) < 0.02
    assert not any("blur" in note for note in lens_of(IDEAL, 4.0).notes)


@pytest.mark.parametrize("missing", ["f_number", "focus_distance_mm"])
def test_what_is_missing_is_asked_for(missing: str):
    unknown = {"f_number": {"fall_off": ()}, "focus_distance_mm": {}}[missing]
    entry = entry_of(None, **unknown)
    if missing == "focus_distance_mm":
        entry = msgspec.structs.replace(entry, focus_distance_mm=None)
    with pytest.raises(LensfitError, match=f"its {missing} is unknown"):
        psf(make_preset(entry).at(), AXIS, 1000.0)


def test_an_object_inside_the_focal_length_is_refused():
    with pytest.raises(LensfitError, match="no sharp image"):
        psf(lens_of(IDEAL), AXIS, 90.0)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"pixel_pitch_mm": 0}, "pixel_pitch_mm = 0 is no distance.*; give"),
        ({"pixel_pitch_mm": -0.006}, "pixel_pitch_mm = -0.006 is no distance.*; give"),
        ({"pixel_pitch_mm": (0.006, np.nan)}, "pixel_pitch_mm = 0.006, nan .*; give"),
        ({"pixel_pitch_mm": np.inf}, "pixel_pitch_mm = inf .*; give"),
        ({"size_px": 0}, "size_px = 0 is no size.*; give"),
        ({"tolerance": 0.0}, "tolerance = 0 is no relative error.*; give"),
    ],
)
def test_pixels_that_cannot_be_are_refused(wrong, says: str):
    lens = lens_of(IDEAL)
    with pytest.raises(LensfitError, match=says):
        psf(lens, FIELD, FOCUS_MM, **wrong)
    options = {"pixel_pitch_mm": 0.006, "size_px": SIZE} | wrong
    with pytest.raises(LensfitError, match=says):
        lens.psfs(np.array([FIELD]), FOCUS_MM, **options)


@pytest.mark.parametrize("point", [(70.0, 4.0), (np.nan, 4.0)])
def test_a_point_that_no_light_comes_to_is_refused(point):
    with pytest.raises(LensfitError, match=r"no light to .*, 4\) mm.*; give a point"):
        psf(lens_of(make_blur()), point, FOCUS_MM)


def test_light_beside_the_array_is_no_kernel():
    """Red a fifth of a millimetre from green, and a pixel of a micrometre."""
    away = ChannelShift((), (0.2, 0.0), 1.02)
    lens = lens_of(IDEAL, lateral_colour=LateralColour(away, away))
    with pytest.raises(LensfitError, match=r"beside the array.*larger array"):
        psf(lens, FIELD, FOCUS_MM, 0.001, "r", size_px=1)


def test_many_points_may_lie_where_no_light_comes():
    """As in the renderer's overscan: zeros there, and the others as they are."""
    lens = lens_of(make_blur())
    points, options = np.array([(70.0, 4.0), FIELD]), {"size_px": SIZE}
    found = lens.psfs(points, FOCUS_MM, ("g",), pixel_pitch_mm=0.006, **options)
    dark, lit = np.asarray(found)[:, 0]
    assert not dark.any()
    np.testing.assert_allclose(lit, psf(lens, FIELD, FOCUS_MM), atol=1e-12)


def test_a_prime_is_refocused_as_a_whole():
    """Sharpest where it is asked to be focused, and says how."""
    preset = make_preset(entry_of(IDEAL))
    for focus_mm in (1000.0, 8000.0):
        lens = preset.at(50.0, 8.0, focus_mm)
        assert any("unit focusing" in note for note in lens.notes)
        moments = [
            second_moment_px2(psf(lens, AXIS, focus_mm * d, 0.002, tolerance=0.02))
            for d in (0.9, 1.0, 1.1)
        ]
        assert moments[1] < min(moments[0], moments[2])


def test_an_unknown_focus_is_what_the_offset_measured():
    """Left out, the lens is as photographed; stated, it is sharp there."""
    blur = msgspec.structs.replace(IDEAL, focus_offset_mm=0.1)
    entry = msgspec.structs.replace(entry_of(blur), focus_distance_mm=None)
    preset = make_preset(entry)
    photographed = psf(preset.at(50.0, 2.0), AXIS, FOCUS_MM)
    moved = psf(moved_sensor(lens_of(IDEAL, 2.0), 0.1), AXIS, FOCUS_MM)
    assert far_from(photographed, moved) < 1e-6
    stated = psf(preset.at(50.0, 2.0, FOCUS_MM), AXIS, FOCUS_MM)
    assert far_from(stated, psf(lens_of(IDEAL, 2.0), AXIS, FOCUS_MM)) < 1e-6


def test_numbers_of_numpy_and_jax_are_welcome():
    preset = make_preset(entry_of(make_blur()))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lens = preset.at(np.float64(50.0), jnp.asarray(2.8), np.float32(2000.0))  # pyright: ignore[reportArgumentType]
    state = (lens.focal_length_mm, lens.f_number, lens.focus_distance_mm)
    assert all(type(value) is float for value in state)
