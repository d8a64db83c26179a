"""Pictures that explain a result, through the batch."""

import numpy as np
import pytest
from plate_makers import DATA, DISPLAY, make_preset, write_plate

from lensfit.io.exr import read_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.plate_depth import DepthOptions
from lensfit.rendering.render_stages import Switches
from lensfit.workflow.apply import apply

PLAIN = Switches(distortion=False, lateral_colour=False)


def made(plate, out, output, **options):
    wanted = ApplyOptions(output=output, **options)
    applied = apply(make_preset(), plate, out, options=wanted)
    assert applied.failures == []
    return read_exr(applied.written[0]).parts[0]


def test_circle_of_confusion_is_the_thin_lens_formula(tmp_path):
    size = (DATA.height, DATA.width)
    depth_m = np.random.default_rng(0).uniform(0.5, 30, size).astype(np.float32)
    depth_m[:, -20:] = np.inf
    plate = write_plate(tmp_path / "p.exr", extra={"Z": depth_m})
    part = made(plate, tmp_path / "out", "circle-of-confusion", switches=PLAIN)
    assert list(part.channels) == ["Y"]
    lens = make_preset().at(35.0, 2.8, 2000.0)
    focus = 2000.0 - float(lens.entrance_pupil_offset_mm)
    focal = 1 / (1 / float(lens.distortion.principal_distance_mm) + 1 / focus)
    with np.errstate(invalid="ignore"):
        away = np.minimum(1000 * depth_m[6:70, 8:104].astype(float), 1e15)
    diameter_mm = (focus - away) / away * focal**2 / (2.8 * (focus - focal))
    assert part.channels["Y"] == pytest.approx(diameter_mm / 36 * 96, rel=1e-4)
    assert part.data_window == DISPLAY
    assert part.channels["Y"].min() < 0 < part.channels["Y"].max()


def test_circle_of_confusion_lies_where_the_result_does(tmp_path):
    depth = np.full((DATA.height, DATA.width), 6.0, np.float32)
    depth[:, :30] = 1.0
    plate = write_plate(tmp_path / "p.exr", extra={"Z": depth})
    plain = made(plate, tmp_path / "a", "circle-of-confusion", switches=PLAIN)
    bent = made(plate, tmp_path / "b", "circle-of-confusion", keep_overscan=True)
    assert (plain.channels["Y"][:, :22] > 0).all()
    edge = (bent.channels["Y"][6:-6, 8:-8] > 0).sum(1)
    assert edge[32] != edge[0]


def test_no_depth_no_circle(tmp_path):
    plate = write_plate(tmp_path / "p.exr")
    options = ApplyOptions(output="circle-of-confusion", depth=DepthOptions())
    applied = apply(make_preset(), plate, tmp_path / "out", options=options)
    assert "no depth" in applied.failures[0]


def test_dots_and_kernels_of_a_perfect_lens(tmp_path):
    plate = write_plate(tmp_path / "p.exr")
    dots = made(plate, tmp_path / "dots", "aberration-dots")
    assert dots.data_window == DISPLAY
    assert set(dots.channels) == {"R", "G", "B"}
    assert dots.channels["G"][32, 48] > 0.5
    kernels = made(plate, tmp_path / "filter", "filter")
    assert {n.rpartition(".")[0] for n in kernels.channels} == {"", "focus", "near"}
    total = kernels.channels["focus.G"].sum()
    assert total == pytest.approx(45, rel=0.01)
    assert "filter" in kernels.attributes["lensfit/applied"]
    # Half the focus distance is as far out of focus as infinity: the same light.
    assert kernels.channels["near.G"].sum() == pytest.approx(45, rel=0.01)
    assert kernels.channels["near.G"].max() < kernels.channels["focus.G"].max()
