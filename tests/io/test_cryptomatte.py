"""Cryptomatte: hashes, manifests and coverages, against published values."""

import json

import numpy as np
import pytest

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.cryptomatte import (
    coverage_of,
    find_cryptomattes,
    id_of,
    murmur3_32,
    object_id,
    read_ranks,
)
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr

WINDOW = Window.of_size(3, 2)


@pytest.mark.parametrize(
    ("text", "seed", "value"),
    [
        (b"", 0, 0),
        (b"", 1, 0x514E28B7),
        (b"", 0xFFFFFFFF, 0x81F16F39),
        (b"\xff\xff\xff\xff", 0, 0x76293B50),
        (b"!Ce\x87", 0, 0xF55B516B),
        (b"!Ce", 0, 0x7E4A8634),
        (b"!C", 0, 0xA0F7B07A),
        (b"!", 0, 0x72661CF4),
        (b"test", 0, 0xBA6BD213),
        (b"Hello, world!", 0x9747B28C, 0x24884CBA),
        (b"The quick brown fox jumps over the lazy dog", 0x9747B28C, 0x2FA826CD),
    ],
)
def test_murmur_hash_has_its_published_values(text, seed, value):
    assert murmur3_32(text, seed) == value


def test_no_id_is_infinite_nan_or_denormal():
    names = [f"object{n}" for n in range(4000)]
    ids = np.array([object_id(name) for name in names], np.uint32)
    assert np.isfinite(ids.view(np.float32)).all()
    assert (np.abs(ids.view(np.float32)) >= np.finfo(np.float32).tiny).all()
    changed = [n for n in names if object_id(n) != murmur3_32(n.encode())]
    assert changed
    assert all(object_id(n) ^ murmur3_32(n.encode()) == 1 << 23 for n in changed)


def plate(manifest=None, sidecar=None, split=False):
    ids = np.array([object_id("cube"), object_id("wire")], np.uint32).view(np.float32)
    size = (WINDOW.height, WINDOW.width)
    cube, wire = np.full(size, ids[0]), np.full(size, ids[1])
    ranks = {
        "r": cube,
        "g": np.full(size, np.float32(0.75)),
        "b": wire,
        "a": np.full(size, np.float32(0.25)),
    }
    header = {
        "cryptomatte/542cafa/name": "CryptoObject",
        "cryptomatte/542cafa/hash": "MurmurHash3_32",
        "cryptomatte/542cafa/conversion": "uint32_to_float32",
    }
    if manifest is not None:
        header["cryptomatte/542cafa/manifest"] = json.dumps(manifest)
    if sidecar is not None:
        header["cryptomatte/542cafa/manif_file"] = sidecar
    prefix = "" if split else "CryptoObject00."
    part = ExrPart(
        {prefix + k: v for k, v in ranks.items()},
        WINDOW,
        WINDOW,
        header,
        name="CryptoObject00" if split else "",
    )
    beauty = ExrPart({"R": cube * 0}, WINDOW, WINDOW, name="rgb")
    return ExrImage((beauty, part)) if split else ExrImage((part,))


@pytest.mark.parametrize("split", [False, True])
def test_coverage_of_named_objects(tmp_path, split):
    path = tmp_path / "plate.exr"
    write_exr(path, plate({"cube": f"{object_id('cube'):08x}"}, split=split))
    (crypto,) = find_cryptomattes(read_exr(path), path)
    ranks = read_ranks(crypto)
    cube, wire = id_of(crypto, "cube"), id_of(crypto, "wire")
    assert ranks.ids[:, 0, 0].tolist() == [cube, wire]
    assert coverage_of(ranks, [cube]) == pytest.approx(0.75)
    assert coverage_of(ranks, [wire]) == pytest.approx(0.25)  # by its hash alone
    assert coverage_of(ranks, [cube, wire]) == pytest.approx(1)
    assert not coverage_of(ranks, [id_of(crypto, "nothing")]).any()


def test_a_manifest_may_lie_beside_the_picture(tmp_path):
    (tmp_path / "names.json").write_text(json.dumps({"renamed": "0000002a"}))
    (crypto,) = find_cryptomattes(plate(sidecar="names.json"), tmp_path / "p.exr")
    assert id_of(crypto, "renamed") == 42


@pytest.mark.parametrize("sidecar", ["../names.json", "/etc/passwd", "none.json"])
def test_a_manifest_elsewhere_or_missing_is_refused(tmp_path, sidecar):
    with pytest.raises(ImageError):
        find_cryptomattes(plate(sidecar=sidecar), tmp_path / "p.exr")


def test_a_broken_manifest_is_told(tmp_path):
    image = plate({"cube": "no number"})
    with pytest.raises(ImageError, match="manifest"):
        find_cryptomattes(image, tmp_path / "p.exr")
