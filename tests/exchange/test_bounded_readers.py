"""Whatever a file holds, every reader ends soon and says one sentence."""

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from lensfit.errors import ExchangeError, LensfitError
from lensfit.exchange.lensfun_xml import read_lensfun
from lensfit.exchange.opencv import read_opencv
from lensfit.exchange.opentrackio import read_opentrackio
from lensfit.exchange.tde4_node import read_tde4_nodes
from lensfit.exchange.text_file import LARGEST_BYTES

READERS = [read_lensfun, read_opencv, read_opentrackio, read_tde4_nodes]
ENTITY, NINE = "&a{};", range(1, 10)
BOMB = (
    '<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "ha">'
    + "".join(f'<!ENTITY a{k} "{10 * ENTITY.format(k - 1 or "")}">' for k in NINE)
    + "]><lensdatabase>&a9;</lensdatabase>"
)
FILES = {
    "empty": b"",
    "bomb": BOMB.encode(),
    "outside": b'<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><x>&e;</x>',
    "outside DTD": b'<!DOCTYPE x SYSTEM "/etc/passwd"><lensdatabase>&e;</lensdatabase>',
    "deep XML": b"<a>" * 200_000,
    "many elements": b"<r>" + b"<a/>" * 900_000 + b"</r>",
    "deep JSON": b"[" * 1_000_000,
    "many rows": b"%YAML:1.0\n---\ncamera_matrix: [" + b"1," * 1_500_000 + b"]\n",
    "braces": b"LD_3DE4_Radial_Standard_Degree_4 {\n a " + b"{" * 1_000_000,
    "open braces": b"LD_3DE4_Radial_Standard_Degree_4 {\n"
    + b' b c"\n'
    + b" a {\n" * 700_000
    + b'"\n}\nx {',
    "open lists": b"camera_matrix:" + b" data:[\n" * 400_000,
    "long name": b"LD_3DE4_" + b"A" * 3_000_000 + b" {\n}\n",
    "nodes": b"A {\n}\n" * 600_000,
    "too large": b"1" * (LARGEST_BYTES + 1),
    "nothing but zero": b"\0" * 1000,
    "no UTF-8": b"\xff\xfe\x00<\x00a",
    "other encoding": b'<?xml version="1.0" encoding="ebcdic-nonsense"?><a/>',
    "surrogates": b'{"lens": "\\ud800"}',
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", list(FILES))
def test_hostile_files_are_refused(
    tmp_path: Path, reader: Callable[[Path], object], name: str
):
    path = tmp_path / "lens"
    path.write_bytes(FILES[name])
    with pytest.raises(ExchangeError) as caught:
        reader(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused(tmp_path: Path, reader: Callable):
    for path in (tmp_path, tmp_path / "missing", Path("/dev/null"), "a\0b"):
        with pytest.raises(ExchangeError):
            reader(path)


def sound_files(tmp_path: Path) -> dict[Callable, str]:
    from test_lensfun_exchange import DATABASE
    from test_tde4_node import PASTED

    yaml = (
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n"
        "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 600., 0., 320., 0., 600., 240., 0., 0., 1. ]\n"
        "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
        "   data: [ -.1, .01, 0., 0., 0. ]\n"
    )
    json = (
        '{"static": {"camera": {"activeSensorPhysicalDimensions": {"height": 18, '
        '"width": 24}}, "lens": {"calibrationHistory": ["custom: lensfit layout 1"]}},'
        '"lens": {"custom": [1, 50, 0], "pinholeFocalLength": 50, "distortion": '
        '[{"radial": [1e-3, 2e-4]}], "exposureFalloff": {"a1": 1e-3}}}'
    )
    return {
        read_lensfun: DATABASE,
        read_opencv: yaml,
        read_opentrackio: json,
        read_tde4_nodes: PASTED,
    }


@pytest.mark.parametrize("reader", READERS)
def test_damage_is_read_or_refused_and_never_more(tmp_path: Path, reader: Callable):
    """Bytes cut out, put twice or exchanged, at random."""
    rng = random.Random(7)
    sound = sound_files(tmp_path)[reader].encode()
    path = tmp_path / "lens"
    path.write_bytes(sound)
    reader(path)
    refused = 0
    for _ in range(300):
        a, b = sorted(rng.randrange(len(sound)) for _ in range(2))
        bad = rng.choice([b"1e999", b"-", b"{", b"[", b"<", b'"'])
        damaged = rng.choice(
            [
                sound[:a] + sound[b:],
                sound[:b] + sound[a:],
                sound[:a] + bytes([rng.randrange(256)]) + sound[a + 1 :],
                sound[:a] + bad + sound[a:],
            ]
        )
        path.write_bytes(damaged)
        try:
            reader(path)
        except LensfitError:
            refused += 1
    assert refused > 30
