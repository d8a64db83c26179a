"""Depth of field in a batch: from channel to frame, and what is said when it lacks."""

import numpy as np
import pytest
from deep_files import write_deep
from plate_makers import CAMERA, DATA, DISPLAY, SENSOR, make_preset, scene, write_plate

from lensfit.coords import uv_from_px
from lensfit.io.cryptomatte import object_id
from lensfit.io.exr import read_exr
from lensfit.io.stmap import write_stmap
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.plate_depth import DepthOptions
from lensfit.rendering.frame import render
from lensfit.rendering.layer_stack import LayerStack, flattened_layers
from lensfit.rendering.render_stages import Switches
from lensfit.workflow.apply import apply

STATE = (35.0, 2.8, 2000.0)
METRES = DepthOptions(unit="m", kind="perpendicular")


def near_and_far():
    """A near left half and a far right one, millimetres."""
    depth = np.full((DATA.height, DATA.width), 6000, np.float32)
    depth[:, :50] = 300
    return depth


def rendered(plate, out, **options):
    applied = apply(make_preset(), plate, out, options=ApplyOptions(**options))
    assert applied.failures == []
    return read_exr(applied.written[0]).parts[0], applied.notes


def test_depth_reaches_the_renderer(tmp_path):
    depth = near_and_far()
    plate = write_plate(tmp_path / "p.exr", extra={"Z": depth / 1000})
    part, notes = rendered(plate, tmp_path / "out", depth=METRES)
    rgba = np.concatenate([scene(DATA), np.ones_like(depth)[..., None]], -1)
    exact = render(
        rgba,
        depth,
        make_preset().at(*STATE),
        data_window=DATA,
        display_window=DISPLAY,
    )
    assert notes == []
    for index, name in enumerate("RGB"):
        assert np.abs(part.channels[name] - exact[..., index]).max() < 1e-5
    sharp, _ = rendered(plate, tmp_path / "sharp", switches=Switches(defocus=False))
    assert np.abs(sharp.channels["R"] - part.channels["R"]).max() > 0.02
    # Depth itself still describes the undistorted plate.
    own = (depth / 1000)[6:70, 8:104]
    assert part.channels["Z"].tobytes() == own.tobytes()


def test_no_depth_and_no_defocus_are_the_same_picture(tmp_path):
    plain = write_plate(tmp_path / "plain.exr")
    (failure,) = apply(make_preset(), plain, tmp_path / "none").failures
    assert "no depth channel" in failure
    assert "--no-defocus" in failure
    deep = write_plate(tmp_path / "z.exr", extra={"Z": near_and_far()})
    sharp = Switches(defocus=False)
    first, _ = rendered(plain, tmp_path / "a", switches=sharp)
    second, _ = rendered(deep, tmp_path / "b", switches=sharp)
    assert np.array_equal(first.channels["G"], second.channels["G"])


@pytest.mark.parametrize("margin", [0, 4, 40])
def test_an_external_map_need_not_reach_as_far_as_the_plate(tmp_path, margin):
    plate = write_plate(tmp_path / "p.exr", extra={"Z": near_and_far() / 1000})
    window = DISPLAY.grown(margin, margin)
    uv = uv_from_px(window.pixel_centres(), DISPLAY).astype(np.float32)
    write_stmap(tmp_path / "map.exr", uv, DISPLAY, window)
    switches = Switches(lateral_colour=False, falloff=False)
    plain = Switches(distortion=False, lateral_colour=False, falloff=False)
    mapped, _ = rendered(
        plate,
        tmp_path / "a",
        stmap=tmp_path / "map.exr",
        depth=METRES,
        switches=switches,
    )
    straight, _ = rendered(plate, tmp_path / "b", depth=METRES, switches=plain)
    gap = np.abs(mapped.channels["G"] - straight.channels["G"])
    assert gap[8:-8, 8:-8].max() < 0.01


def with_objects(depth):
    """A plate whose left object has a soft edge two pixels wide, at the far depth."""
    ids = np.array([object_id("left"), object_id("right")], np.uint32).view(np.float32)
    left = np.zeros_like(depth)
    left[:, :50], left[:, 50:52] = 1, 0.5
    header = {**CAMERA, **SENSOR, "cryptomatte/542cafa/name": "CryptoObject"}
    return header, {
        "Z": depth / 1000,
        "CryptoObject00.r": np.where(left >= 0.5, ids[0], ids[1]),
        "CryptoObject00.g": np.where(left >= 0.5, left, 1 - left),
        "CryptoObject00.b": np.where(left >= 0.5, ids[1], ids[0]),
        "CryptoObject00.a": np.where(left >= 0.5, 1 - left, left),
    }


def test_an_edge_mask_changes_the_edge_and_ids_keep_their_bits(tmp_path):
    header, extra = with_objects(near_and_far())
    plate = write_plate(tmp_path / "p.exr", header, extra)
    part, _ = rendered(plate, tmp_path / "a", depth=METRES, edge_mask=("left",))
    for name in extra:
        own = extra[name][6:70, 8:104]
        assert part.channels[name].tobytes() == own.tobytes()
    assert "left" in part.attributes["lensfit/applied"]
    options = ApplyOptions(edge_mask=("middle",))
    applied = apply(make_preset(), plate, tmp_path / "b", options=options)
    (failure,) = applied.failures
    assert "no object 'middle'" in failure
    plain = write_plate(tmp_path / "q.exr", extra={"Z": near_and_far()})
    options = ApplyOptions(edge_mask=("left",))
    (failure,) = apply(make_preset(), plain, tmp_path / "c", options=options).failures
    assert "no Cryptomatte" in failure


def wire_before_a_wall(tmp_path, depth_of, crest):
    """A plate with a near wire, soft at its edges, and the frame that a lens makes of
    it, from layers that know what the wire hides."""
    y, x = np.moveaxis(DATA.pixel_centres(), -1, 0)[::-1]
    share = np.clip(crest - np.abs(x - 40 - y / 4), 0, 1).astype(np.float32)
    near, far = np.float32(300), np.float32(6000)
    wire, wall = np.float32([2.5, 0.3, 0.1]), scene(DATA)
    layers = np.ones((2, *share.shape, 4), np.float32)
    layers[0, ..., :3], layers[1, ..., :3] = share[..., None] * wire, wall
    layers[0, ..., 3] = share
    stack = LayerStack(layers, np.stack([np.full_like(share, z) for z in (near, far)]))
    exact = render(
        stack,
        None,
        make_preset().at(*STATE),
        tolerance=1e-3,
        data_window=DATA,
        display_window=DISPLAY,
    )
    ids = np.array([object_id("wire"), object_id("wall")], np.uint32).view(np.float32)
    first = share >= 0.5
    rgb = flattened_layers(stack)
    extra = {
        **{name: rgb[..., index] for index, name in enumerate("RGB")},
        "Z": depth_of(share, near, far).astype(np.float32) / 1000,
        "CryptoObject00.r": np.where(first, ids[0], ids[1]),
        "CryptoObject00.g": np.maximum(share, 1 - share),
        "CryptoObject00.b": np.where(first, ids[1], ids[0]),
        "CryptoObject00.a": np.minimum(share, 1 - share),
        "mattes.wire": share,
    }
    header = {**CAMERA, **SENSOR, "cryptomatte/542cafa/name": "CryptoObject"}
    return write_plate(tmp_path / "wire.exr", header, extra), exact


SHARED = {
    "farthest": lambda c, near, far: np.where(c < c.max(), far, near),
    "centre": lambda c, near, far: np.where(c > 0.5, near, far),
    "nearest": lambda c, near, far: np.where(c > 0, near, far),
}


@pytest.mark.parametrize(
    ("crest", "part", "most"),
    [(2, 0.7, 0.0025), (0.8, 0.3, 0.001)],
    ids=["wire", "thinner than a pixel"],
)
@pytest.mark.parametrize("whose", SHARED)
def test_an_edge_mask_makes_up_for_depth_that_a_wire_shares(
    tmp_path, whose, crest, part, most
):
    plate, exact = wire_before_a_wall(tmp_path, SHARED[whose], crest)
    rms = []
    for name, mask in (("plain", ()), ("masked", ("wire",))):
        made, _ = rendered(
            plate, tmp_path / name, depth=METRES, edge_mask=mask, tolerance=1e-3
        )
        gap = np.stack([made.channels[c] for c in "RGB"], -1) - exact[..., :3]
        rms.append(float(np.sqrt(np.mean(gap[8:-8, 8:-8] ** 2))))
    assert rms[1] < part * rms[0]
    assert rms[1] < most


@pytest.mark.parametrize("whose", SHARED)
def test_an_edge_matte_does_what_the_name_of_its_object_does(tmp_path, whose):
    plate, exact = wire_before_a_wall(tmp_path, SHARED[whose], 2)
    rms = []
    for name, options in (("plain", {}), ("matte", {"edge_matte": "mattes.wire"})):
        options |= {"depth": METRES, "tolerance": 1e-3}
        made, _ = rendered(plate, tmp_path / name, **options)
        gap = np.stack([made.channels[c] for c in "RGB"], -1) - exact[..., :3]
        rms.append(float(np.sqrt(np.mean(gap[8:-8, 8:-8] ** 2))))
    assert rms[1] < 0.7 * rms[0]
    assert rms[1] < 0.0025
    assert "edges by channel mattes.wire" in made.attributes["lensfit/applied"]


def test_an_edge_matte_of_nothing_changes_nothing_and_a_missing_one_is_named(tmp_path):
    depth = near_and_far()
    extra = {"Z": depth / 1000, "empty": np.zeros_like(depth)}
    plate = write_plate(tmp_path / "p.exr", extra=extra)
    plain, _ = rendered(plate, tmp_path / "a", depth=METRES)
    empty, _ = rendered(plate, tmp_path / "b", depth=METRES, edge_matte="empty")
    for name in "RGB":
        assert plain.channels[name] == pytest.approx(empty.channels[name], abs=1e-6)
    options = ApplyOptions(edge_matte="fence")
    (failure,) = apply(make_preset(), plate, tmp_path / "c", options=options).failures
    assert "no channel 'fence'" in failure
    assert "empty" in failure


def write_deep_plate(path, front_alpha):
    """A layer at the focus distance over a wall; every pixel has two samples."""
    shape = DISPLAY.height, DISPLAY.width
    wall, front = scene(DISPLAY), 0.8 * front_alpha
    behind_ahead = {name: (wall[..., k], front) for k, name in enumerate("RGB")}
    behind_ahead |= {"A": (1.0, front_alpha), "Z": (9.0, 2.0)}
    samples = {}
    for name, pair in behind_ahead.items():
        planes = [np.broadcast_to(np.float32(value), shape) for value in pair]
        samples[name] = np.stack(planes, -1).ravel()
    return write_deep(path, np.full(shape, 2), samples, {**CAMERA, **SENSOR})


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_a_deep_plate_is_returned_flat(tmp_path, alpha):
    plate = write_deep_plate(tmp_path / "deep.exr", alpha)
    wall = np.concatenate([scene(DISPLAY), np.ones((*scene(DISPLAY).shape[:2], 1))], -1)
    flat = 0.8 * alpha * np.array([1, 1, 1, 0]) + (1 - alpha) * wall
    flat[..., 3] = 1
    part, notes = rendered(plate, tmp_path / "a", switches=Switches(defocus=False))
    lens = make_preset().at(*STATE)
    exact = render(flat, None, lens)
    assert set(part.channels) == set("RGBA")
    for index, name in enumerate("RGBA"):
        assert np.abs(part.channels[name] - exact[..., index]).max() < 1e-5
    assert any("flat" in note for note in notes)
    # The wall is out of focus: it loses its detail, the layer in front does not.
    blurred, _ = rendered(plate, tmp_path / "b", depth=METRES)
    inner = np.s_[16:-16, 16:-16]
    detail = [np.std(p.channels["R"][inner]) for p in (part, blurred)]
    assert detail[1] <= detail[0] + 1e-4
    same = ApplyOptions(depth=METRES)
    again = apply(make_preset(), plate, tmp_path / "b", options=same)
    assert again.skipped
    assert again.failures == []
