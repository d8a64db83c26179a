"""Written maps: what another program reads back from the files."""

import numpy as np
import pytest
from plate_makers import make_preset

from lensfit.coords import Window, px_from_uv
from lensfit.errors import OutputError
from lensfit.exchange.stmaps import StmapFrame, file_stem, write_stmaps
from lensfit.io.stmap import read_stmap
from lensfit.preset.blocks import (
    Camera,
    ChannelShift,
    Distortion,
    LateralColour,
    Projection,
)
from lensfit.preset.entry import Entry, Quality
from lensfit.preset.lens_of_entry import lens_of_entry
from lensfit.rendering.uv import PlateGeometry
from lensfit.workflow.overscan import OverscanQuestion, plan_overscan

FRAME = StmapFrame((160, 120), overscan_percent=15.0)


def make_lens(log_slope=(-0.2,), coloured=True):
    shifts = LateralColour(
        ChannelShift((2e-3,), (0.0, 0.0), 1.5), ChannelShift((-2e-3,), (0.0, 0.0), 1.5)
    )
    entry = Entry(
        focal_length_mm=50.0,
        focus_distance_mm=2000.0,
        projection=Projection(51.0, (0.0, 0.0), 60.0),
        distortion=Distortion(
            base="rectilinear",
            reference_radius_mm=15.0,
            valid_radius=1.5,
            valid_box=(-1.5, -1.5, 1.5, 1.5),
            radial_log_slope=log_slope,
        ),
        lateral_colour=shifts if coloured else None,
        fall_off=(),
        terms=(),
        covariance=None,
        quality=Quality(0.02, 0.02, 100, 100, 1),
    )
    return lens_of_entry(entry, Camera(None, 24.0, 18.0, 1600, 1200), None)


def test_windows_and_names(tmp_path):
    written = write_stmaps(make_lens(), FRAME, tmp_path, "fifty")
    names = [path.name for path in written.paths]
    assert names == ["fifty_undistort.exr", "fifty_redistort.exr"]
    read = read_stmap(written.paths[1])
    assert read.display_window == Window.of_size(160, 120)
    assert read.data_window == Window(-12, -9, 171, 128)
    assert read.uv.dtype == np.float32
    assert read.uv.shape == (138, 184, 2)


def test_files_close_the_loop_within_a_thousandth_of_a_pixel(tmp_path):
    lens = make_lens()
    written = write_stmaps(lens, FRAME, tmp_path, "fifty", per_channel=True)
    undistort, redistort = map(read_stmap, written.paths)
    geometry = PlateGeometry.of(lens, FRAME.display_window)
    own = FRAME.data_window.pixel_centres()
    for channel in ("r", "g", "b"):
        for made, back in (
            (undistort, geometry.undistorted(lens, channel)),
            (redistort, geometry.distorted(lens, channel)),
        ):
            positions = px_from_uv(made.channel_uv[channel], FRAME.display_window)
            closed = back(positions.reshape(-1, 2)).reshape(own.shape)
            assert np.abs(closed - own).max() < 1e-3
    assert np.array_equal(undistort.uv, undistort.channel_uv["g"])


def test_an_ideal_lens_writes_the_identity_exact_to_float32(tmp_path):
    ideal = make_lens(log_slope=(), coloured=False)
    frame = StmapFrame((160, 120))
    for path in write_stmaps(ideal, frame, tmp_path, "ideal").paths:
        uv = read_stmap(path).uv
        u = ((np.arange(160) + 0.5) / 160).astype(np.float32)
        v = (1 - (np.arange(120) + 0.5) / 120).astype(np.float32)
        assert np.array_equal(uv[..., 0], np.broadcast_to(u, (120, 160)))
        assert np.array_equal(uv[..., 1], np.broadcast_to(v[:, None], (120, 160)))


def test_one_direction_only_and_the_overscan_that_is_needed(tmp_path):
    written = write_stmaps(make_lens(), FRAME, tmp_path, "fifty", direction="redistort")
    assert [path.name for path in written.paths] == ["fifty_redistort.exr"]
    uv = read_stmap(written.paths[0]).uv[9:-9, 12:-12]
    # Beyond the outermost position lie the taps of the filter; red reaches farther.
    beyond = written.margins.left + uv[..., 0].min() * 160
    assert 1.0 < beyond < 3.5
    assert written.overscan_percent > 1


def test_it_is_the_overscan_that_the_command_for_it_says(tmp_path):
    preset = make_preset()
    question = OverscanQuestion((160, 120), focus_distance_mm=(2000.0, 2000.0))
    plan = plan_overscan(preset, question)
    lens = preset.at(focus_distance_mm=2000.0)
    written = write_stmaps(lens, StmapFrame((160, 120)), tmp_path, "one")
    assert written.margins == plan.margins
    assert written.overscan_percent == plan.camera.percent
    assert written.factor == plan.factor


def test_names_of_states_are_plain_file_names():
    assert file_stem("SMC Takumar 50/1.4", make_lens()) == (
        "smc-takumar-50-1-4_50mm_2000mm"
    )


def test_impossible_frames_are_refused(tmp_path):
    for frame in (StmapFrame((0, 10)), StmapFrame((10, 10), -5.0)):
        with pytest.raises(OutputError):
            write_stmaps(make_lens(), frame, tmp_path, "x")
    assert not list(tmp_path.iterdir())
