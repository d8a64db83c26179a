"""An option that no rendering could follow is refused, finished frames or not."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from plate_makers import CAMERA, DATA, SENSOR, make_preset, write_plate

from lensfit.errors import ImageError
from lensfit.io.cryptomatte import object_id
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.plate_depth import DepthOptions
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs
from lensfit.workflow.apply import apply

PLAIN = ApplyOptions()


def objects() -> dict[str, np.ndarray]:
    """Depth, and one object that covers all pixels; its name is not in a manifest."""
    shape = (DATA.height, DATA.width)
    ids = np.full(shape, object_id("fence"), np.uint32).view(np.float32)
    ones, nothing = np.ones(shape, np.float32), np.zeros(shape, np.float32)
    ranks = {"r": ids, "g": ones, "b": nothing, "a": nothing}
    return {"Z": 3 * ones} | {
        f"crypto00.{leaf}": plane for leaf, plane in ranks.items()
    }


@pytest.fixture
def plate(tmp_path):
    header = {**CAMERA, **SENSOR, "cryptomatte/1/name": "crypto"}
    return write_plate(tmp_path / "plate.0001.exr", header, objects())


def outcome(plate, out, options=PLAIN, preset=None):
    done = apply(preset or make_preset(), plate, out, options=options)
    return done.failures, len(done.skipped)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"layers": ["diffuse"]}, "holds no R, G, B to render in 'diffuse'"),
        ({"depth": DepthOptions(channel="no")}, "has no channel 'no' to read depth"),
        ({"depth": DepthOptions(kind="normalised")}, "give --depth-near and"),
        ({"edge_matte": "no"}, "has no channel 'no' that could be an edge matte"),
        ({"edge_mask": ("gate",)}, "has no object 'gate'"),
    ],
)
def test_a_finished_frame_fails_as_an_unfinished_one(plate, tmp_path, changes, said):
    assert outcome(plate, tmp_path / "done") == ([], 0)
    options = replace(PLAIN, **changes)
    (failure,), skipped = outcome(plate, tmp_path / "done", options)
    assert said in failure
    assert skipped == 0
    assert outcome(plate, tmp_path / "new", options) == ([failure], 0)


@pytest.mark.parametrize(
    "changes",
    [
        {"layers": [""]},
        {"depth": DepthOptions(channel="Z", unit="cm")},
        {"edge_matte": "A"},
        {"edge_mask": ("fence",)},
        {"output": "circle-of-confusion"},
    ],
)
def test_a_finished_frame_is_rendered_again_with_other_options(
    plate, tmp_path, changes
):
    options = replace(PLAIN, **changes)
    assert outcome(plate, tmp_path / "out") == ([], 0)
    assert outcome(plate, tmp_path / "out", options) == ([], 0)
    assert outcome(plate, tmp_path / "out", options) == ([], 1)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ApplyOptions(knobs={"filter_image": "no.png"}),
            r"no\.png: cannot be read .* filter image .* with --filter-image",
        ),
        (
            ApplyOptions(depth=DepthOptions(unit="furlong")),
            r"'furlong' is no unit of depth \(--depth-unit\)",
        ),
    ],
)
@pytest.mark.parametrize("finished", [False, True])
def test_what_no_plate_can_change_is_said_once_for_all(
    plate, tmp_path, options, said, finished
):
    if finished:
        outcome(plate, tmp_path / "out")
    with pytest.raises(ImageError, match=said):
        outcome(plate, tmp_path / "out", options)


def test_a_filter_image_of_the_preset_is_looked_at_too(plate, tmp_path):
    preset = msgspec.structs.replace(
        make_preset(), knobs=adjusted_knobs(NEUTRAL, {"filter_image": "gone.png"})
    )
    outcome(plate, tmp_path / "out")
    (failure,), skipped = outcome(plate, tmp_path / "out", preset=preset)
    assert "gone.png" in failure
    assert "--filter-image" in failure
    assert skipped == 0
