"""Photographs: energy, centroids, two ways of making them, noise, files, seeds."""

import dataclasses
import json
import tomllib

import numpy as np
import pytest

from data_synth.aim import chief_landings_mm, tracer_from_object
from data_synth.chart import Chart, Pose, pattern_coverage
from data_synth.dots import expose_dots
from data_synth.irradiance import plane_irradiance
from data_synth.lens import set_lens
from data_synth.make_demo import FOLDER, make_demo
from data_synth.patterns import expose_pattern, expose_white
from data_synth.prescription import load_prescription
from data_synth.sensor import (
    MOSAIC,
    Frame,
    Sensor,
    camera_bands,
    demosaiced,
    digitise,
    srgb_codes,
)
from data_synth.shoot import Camera, Shot, field_table, shoot_toml, take, write_shoot
from data_synth.surfaces import Surface
from data_synth.trace import Stop
from lensfit.mosaic import photosites

FRAME = Frame((320, 240), (28.0, 21.0))
DISTANCE_MM = 1500.0


@pytest.fixture(scope="module")
def lens():
    return set_lens(
        load_prescription("nikkor_28"), f_number=4.0, focus_distance_mm=DISTANCE_MM
    )


@pytest.fixture(scope="module")
def dots(lens):
    chart = Chart("dot-grid", pitch_mm=220.0, mark_mm=24.0)
    return expose_dots(
        lens, chart, Pose(DISTANCE_MM), FRAME, camera_bands(), rays_per_wavelength=4096
    )


def window(image, centre_px, half=14):
    """Sum, and mean position, of the light around a point, per channel."""
    column, row = (int(v) for v in centre_px)
    rows, columns = slice(row - half, row + half), slice(column - half, column + half)
    patch = image[rows, columns]
    y, x = np.mgrid[rows, columns] + 0.5
    total = patch.sum(axis=(0, 1))
    x_mean = (patch * x[..., None]).sum(axis=(0, 1)) / total
    y_mean = (patch * y[..., None]).sum(axis=(0, 1)) / total
    return total, np.stack([x_mean, y_mean], -1)


def inner(truth, margin=16):
    chief = truth.chief_px[1]
    size = np.array(FRAME.size_px)
    return np.flatnonzero(((chief > margin) & (chief < size - margin)).all(axis=1))


def test_a_photograph_holds_the_flux_and_the_centroid_that_truth_states(dots):
    image, truth = dots
    assert len(inner(truth)) > 20
    for dot in inner(truth):
        total, mean_px = window(image, truth.chief_px[1, dot])
        np.testing.assert_allclose(total, truth.flux[:, dot], rtol=1e-9)
        # Pixels know a position only to within their own area.
        assert np.abs(mean_px - truth.centroid_px[:, dot]).max() < 0.02


def test_flux_falls_towards_the_corner_as_the_traced_illumination(lens, dots):
    """Dots of equal area: flux = irradiance x area of the dot's image."""
    _, truth = dots
    object_mm = np.column_stack(
        [truth.chart_mm, np.full(len(truth.index), DISTANCE_MM)]
    )
    chosen = inner(truth)
    step = np.array([[1.0, 0, 0], [0, 1.0, 0]])

    def at(points):
        return chief_landings_mm(lens, tracer_from_object(points), 540.0)

    sides = [at(object_mm + s) - at(object_mm - s) for s in step]
    area = sides[0][:, 0] * sides[1][:, 1] - sides[0][:, 1] * sides[1][:, 0]
    light = plane_irradiance(lens, object_mm, 540.0)
    predicted = light * area
    middle = np.flatnonzero((truth.index == 0).all(axis=1))[0]
    ratio = truth.flux[1] / truth.flux[1, middle] / (predicted / predicted[middle])
    np.testing.assert_allclose(ratio[chosen], 1.0, atol=0.01)
    assert truth.flux[1, chosen].min() < 0.8 * truth.flux[1, middle]


def test_fall_off_without_vignetting_is_cosine_to_the_fourth(lens):
    """A hole in front of the sensor and nothing else: the textbook law is exact."""
    hole = (Surface(0.0, 0.0, 28.0, is_stop=True),)
    pinhole = dataclasses.replace(
        lens, surfaces=hole, stop=Stop(0.5), pupil_z_mm=-28.0, pupil_radius_mm=0.5
    )
    object_mm = np.array([[0.0, 0, 2000], [800.0, 0, 2000], [900.0, 700, 2000]])
    depth_mm = 2000 - 28.0
    cosine = depth_mm / np.hypot(depth_mm, np.hypot(*object_mm[:, :2].T))
    light = plane_irradiance(pinhole, object_mm, 540.0)
    np.testing.assert_allclose(light / light[0], cosine**4, rtol=2e-3)


@pytest.mark.slow
def test_both_ways_of_making_a_photograph_agree(lens):
    """Brute-force rays against warps: same dots, same flux, same centroids.

    What remains is mostly the sampling noise of the rays (0.4 um here).
    """
    chart = Chart("dot-grid", pitch_mm=220.0, mark_mm=40.0)
    pose = Pose(DISTANCE_MM, tilt_deg=5.0, roll_deg=3.0)
    bands = camera_bands()
    by_rays, truth = expose_dots(
        lens, chart, pose, FRAME, bands, rays_per_wavelength=2048
    )
    by_warps, misfit_px = expose_pattern(
        lens, chart, pose, FRAME, bands, pupil_cells_across=5
    )
    assert misfit_px < 1e-4
    for dot in inner(truth, 20)[::3]:
        flux_rays, at_rays = window(by_rays, truth.chief_px[1, dot])
        flux_warps, at_warps = window(by_warps, truth.chief_px[1, dot])
        np.testing.assert_allclose(flux_warps / flux_rays, 1.0, atol=0.02)
        assert np.abs(at_warps - at_rays).max() < 0.03


@pytest.mark.slow
def test_few_cells_of_the_pupil_draw_blur_without_steps():
    """A wide open lens out of focus, vignetted: against twice as many cells across."""
    fast = set_lens(
        load_prescription("biotar_50"), f_number=1.4, focus_distance_mm=3300.0
    )
    frame = Frame((96, 72), (24.0, 18.0))
    chart, bands = Chart("checkerboard", pitch_mm=160.0, mark_mm=1.0), camera_bands(1)
    few, many = (
        expose_pattern(
            fast, chart, Pose(2000.0), frame, bands, pupil_cells_across=across
        )[0]
        for across in (7, 15)
    )
    off = np.abs(few - many)
    assert np.sqrt(np.mean(off**2)) < 0.005
    assert np.percentile(off, 99) < 0.02


@pytest.mark.slow
def test_an_open_chart_has_the_traced_illumination_at_every_pixel(lens):
    """A line grid whose lines fill the chart is an evenly bright field."""
    open_chart = Chart("line-grid", pitch_mm=100.0, mark_mm=100.0)
    frame = Frame((64, 48), FRAME.size_mm)
    image, _ = expose_pattern(
        lens,
        open_chart,
        Pose(DISTANCE_MM),
        frame,
        camera_bands(),
        pupil_cells_across=3,
    )
    assert image[23:25, 31:33].mean() == pytest.approx(1.0, abs=3e-3)
    table = np.array(field_table(lens, frame))
    for row in table:
        column, line = row[5:7]
        if 1 < column < 63 and 1 < line < 47:
            got = image[int(line), int(column), 1]
            assert got == pytest.approx(row[10], abs=0.03)


@pytest.mark.parametrize("kind", ["line-grid", "checkerboard"])
def test_coverage_is_the_mean_over_the_footprint(kind):
    chart = Chart(kind, pitch_mm=10.0, mark_mm=3.0)
    rng = np.random.default_rng(4)
    centre = rng.uniform(-30, 30, (40, 2))
    side = rng.uniform(0.5, 4.0, (40, 2))
    offsets = (np.arange(200) + 0.5) / 200 - 0.5
    grid = np.stack(np.meshgrid(offsets, offsets), -1).reshape(1, -1, 2)
    fine = centre[:, None] + grid * side[:, None]
    sampled = pattern_coverage(chart, fine, np.full_like(fine, 1e-6)).mean(axis=1)
    np.testing.assert_allclose(
        pattern_coverage(chart, centre, side), sampled, atol=0.006
    )


def test_noise_has_the_variance_of_shot_and_read_noise():
    level, sensor = 0.3, Sensor(full_well_e=5000.0, read_noise_e=8.0, adc_bits=None)
    picture = digitise(np.full((300, 300, 3), level), sensor, seed=5)
    wanted = (level * 5000 + 8.0**2) / 5000**2
    assert picture.mean() == pytest.approx(level, abs=4 * np.sqrt(wanted / 270000))
    assert picture.var() == pytest.approx(wanted, rel=0.02)


def test_a_sensor_saturates_and_counts_in_steps():
    sensor = Sensor(adc_bits=8)
    picture = digitise(np.linspace(0, 2, 3000).reshape(10, 100, 3), sensor, seed=6)
    assert picture.max() == 1.0
    np.testing.assert_allclose(picture * 255, np.round(picture * 255), atol=1e-9)


def test_same_seed_same_noise():
    level = np.full((20, 20, 3), 0.2)
    first, again = (digitise(level, Sensor(), seed=7) for _ in range(2))
    other = digitise(level, Sensor(), seed=8)
    assert (first == again).all()
    assert (first != other).any()


def test_a_mosaic_keeps_a_smooth_picture():
    y, x = np.mgrid[0:40, 0:60] / 60
    ramp = np.stack([0.2 + 0.5 * x, 0.4 + 0.3 * y, 0.1 + 0.2 * x], -1)
    filled = demosaiced(ramp)
    np.testing.assert_allclose(filled[3:-3, 3:-3], ramp[3:-3, 3:-3], atol=1e-12)


def test_what_a_mosaic_measured_is_kept_where_the_shoot_file_says():
    samples = np.random.default_rng(2).uniform(size=(31, 44, 3))
    own = photosites("rggb", (44, 31))
    assert MOSAIC == "rggb"
    np.testing.assert_array_equal(demosaiced(samples)[own], samples[own])
    assert not np.any(demosaiced(samples)[~own] == samples[~own])


def test_srgb_codes_span_the_byte():
    assert srgb_codes(np.array([[[0.0, 0.2140411, 1.0]]])).tolist() == [[[0, 127, 255]]]


@pytest.mark.slow
def test_a_shoot_is_written_as_lensfit_reads_it_and_is_reproducible(tmp_path):
    camera = Camera(Frame((96, 72), (28.0, 21.0)), Sensor(bayer=True))
    chart = Chart("dot-grid", 400.0, 60.0)
    shots = [
        Shot("a", chart, Pose(DISTANCE_MM), 4.0, DISTANCE_MM, rays_per_wavelength=64),
        Shot("b", chart, Pose(1600.0, tilt_deg=9.0), 4.0, DISTANCE_MM, form="jpg",
             says_distance=False, rays_per_wavelength=64),
    ]  # fmt: skip
    prescription = load_prescription("nikkor_28")
    for folder in ("one", "two"):
        write_shoot(tmp_path / folder, prescription, camera, shots, seed=3)
    table = tomllib.loads((tmp_path / "one/shoot.toml").read_text())
    assert [take["image"] for take in table["take"]] == ["a.exr", "b.jpg"]
    assert table["take"][1]["encoding"] == "srgb"
    assert table["camera"]["mosaic"] == "rggb"
    assert "target_distance_mm" not in table["take"][1]
    truth = json.loads((tmp_path / "one/a_truth.json").read_text())
    assert len(truth["columns"]) == len(truth["dots"][0])
    for name in ("a.exr", "b.jpg", "a_truth.json", "truth_lens.json"):
        first, second = (tmp_path / f / name for f in ("one", "two"))
        assert first.read_bytes() == second.read_bytes()


def test_an_interrupted_shoot_leaves_nothing(tmp_path):
    camera = Camera(Frame((96, 72), (28.0, 21.0)), Sensor())
    chart = Chart("dot-grid", 400.0, 60.0)
    shots = [
        Shot(name, chart, Pose(DISTANCE_MM), 4.0, DISTANCE_MM, rays_per_wavelength=64)
        for name in "ab"
    ]

    def interrupted(name: str) -> None:
        if name == "b":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_shoot(
            tmp_path / "shoot",
            load_prescription("nikkor_28"),
            camera,
            shots,
            progress=interrupted,
        )
    assert not (tmp_path / "shoot").exists()


@pytest.mark.hard
def test_the_bundled_demo_is_what_its_command_makes(tmp_path):
    make_demo(tmp_path)
    for name in ("dots.exr", "dots_tilted.png", "lines.jpg", "shoot.toml"):
        assert (tmp_path / name).read_bytes() == (FOLDER / name).read_bytes(), name


@pytest.mark.slow
def test_a_chart_that_is_white_all_over_is_one_of_lines_that_touch(lens):
    pose = Pose(DISTANCE_MM, tilt_deg=8.0, pan_deg=-5.0)
    lines = Chart("line-grid", pitch_mm=100.0, mark_mm=100.0)
    touching, _ = expose_pattern(lens, lines, pose, FRAME, camera_bands())
    white = expose_white(lens, pose, FRAME, camera_bands())
    np.testing.assert_allclose(touching, white, rtol=1e-6)


@pytest.mark.slow
def test_dark_dots_take_the_light_that_bright_ones_send():
    bright = Chart("dot-grid", pitch_mm=220.0, mark_mm=48.0)
    dark = dataclasses.replace(bright, dark=True)
    prescription, camera = load_prescription("nikkor_28"), Camera(FRAME, Sensor())
    shots = [
        Shot("dots", chart, Pose(DISTANCE_MM), 4.0, DISTANCE_MM, from_maps=True)
        for chart in (bright, dark)
    ]
    (lens, of_bright), (_, of_dark) = (take(prescription, camera, s) for s in shots)
    white = expose_white(lens, Pose(DISTANCE_MM), FRAME, camera_bands())
    # Rims near the frame's edge are drawn up to this much too bright.
    np.testing.assert_allclose(of_dark.image + of_bright.image, white, rtol=0.05)
    truth = of_dark.dots
    for dot in inner(truth):
        taken, mean_px = window(white - of_dark.image, truth.chief_px[1, dot])
        np.testing.assert_allclose(taken, truth.flux[:, dot], rtol=0.01)
        assert np.abs(mean_px - truth.centroid_px[:, dot]).max() < 0.02
        column, row = truth.chief_px[1, dot].astype(int)
        assert of_dark.image[row, column].max() < 0.02 * white[row, column].min()
    said = tomllib.loads(shoot_toml(prescription, camera, shots[1:]))
    assert said["target"][0]["polarity"] == "dark"
