"""What decoders print stays unseen; what anybody else prints does not."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.decoding import silenced_libraries
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr

CHATTER = (
    b"a b.exr: (EXR_ERR_CORRUPT_CHUNK) Unable to decompress w 3 image data\n",
    b"ojph error 0x00030092 at ojph_tile.cpp:973: wrong tile part index\n",
    b"libpng warning: Image width is zero in IHDR\n",
    b"[ERROR:0@1.494] global grfmt_png.cpp:297 readHeader IHDR chunk\n",
    b"[ WARN:0@2.093] global grfmt_png.cpp:793 incomplete\n",
)


def test_only_the_lines_of_decoders_are_kept(capfd):
    with silenced_libraries():
        for line in CHATTER:
            os.write(2, line)
            os.write(1, line)
        os.write(2, b"lensfit: note: still there\n")
        os.write(1, b"result\n")
        os.write(2, b"no line end")
    os.write(2, b", after\n")
    found = capfd.readouterr()
    assert found.err == "lensfit: note: still there\nno line end, after\n"
    assert found.out == "result\n"


def test_blocks_may_lie_in_one_another_and_beside(capfd):
    with silenced_libraries():
        with silenced_libraries():
            os.write(2, CHATTER[0])
        other = threading.Thread(target=_decode)
        other.start()
        other.join()
        os.write(2, CHATTER[2] + b"kept\n")
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "kept\nafter\n"


def _decode() -> None:
    with silenced_libraries():
        os.write(2, CHATTER[1])


def test_streams_are_whole_after_an_error(capfd):
    with pytest.raises(ZeroDivisionError), silenced_libraries():
        1 / 0  # noqa: B018
    os.write(2, CHATTER[0])
    assert capfd.readouterr().err == CHATTER[0].decode()


@pytest.mark.parametrize("name", ["zip", "piz", "dwaa", "htj2k256"])
def test_a_damaged_picture_is_one_line(tmp_path: Path, capfd, name: str):
    path, window = tmp_path / "a.exr", Window.of_size(60, 40)
    ramp = np.tile(np.arange(60, dtype=np.float32), (40, 1))
    write_exr(path, ExrImage((ExrPart({"Y": ramp}, window, window),)), compression=name)
    content = bytearray(path.read_bytes())
    content[-150:] = b"\xff" * 150
    path.write_bytes(bytes(content))
    with pytest.raises(ImageError, match="cannot be decoded"):
        read_exr(path)
    assert capfd.readouterr() == ("", "")


def test_a_service_without_standard_streams_reads_too(tmp_path: Path):
    path, window = tmp_path / "a.exr", Window.of_size(6, 4)
    plane = np.ones((4, 6), np.float32)
    write_exr(path, ExrImage((ExrPart({"Y": plane}, window, window),)))
    script = (
        "import os, sys; os.close(1); os.close(2)\n"
        "from lensfit.io.exr import read_exr\n"
        "sys.exit(read_exr(sys.argv[1]).parts[0].data_window.width)"
    )
    run = subprocess.run([sys.executable, "-c", script, str(path)], check=False)
    assert run.returncode == 6
