"""Small camera files of every kind, as their writers lay them out."""

import struct
from pathlib import Path

ARRI_COLUMNS = (
    "Index",
    "Master TC",
    "Camera Family",
    "Camera Model",
    "Master TC",
    "Image Width",
    "Lens Model",
    "Lens Serial Number",
    "Lens Distance Unit",
    "Lens Focus Distance",
    "Lens Focal Length",
    "Lens Iris",
    "Lens Linear Iris",
)
RED_COOKE = "64/40/40/46"


def arri(folder: Path, *rows: dict[str, str], name: str = "arri.csv") -> Path:
    """A table of ARRI; what a row leaves out has a plausible value."""
    lines = ["\t".join(ARRI_COLUMNS)]
    for at, row in enumerate(rows or ({},)):
        cells = {
            "Index": f"       {at}",
            "Master TC": f"10:00:00:{at:02d}",
            "Camera Family": "ALEXALF",
            "Camera Model": "Alexa LF",
            "Image Width": "4448",
            "Lens Model": "SP40",
            "Lens Serial Number": "n.a.",
            "Lens Distance Unit": "Meter",
            "Lens Focus Distance": f"{2 + at}.000",
            "Lens Focal Length": "40.000",
            "Lens Iris": "1.4 + 7/10",
            "Lens Linear Iris": "2667",
        } | row
        lines.append("\t".join(cells[column] for column in ARRI_COLUMNS))
    return _written(folder / name, "\n".join(lines) + "\n")


def red_frames(folder: Path, *focus_mm: float, cooke: str = RED_COOKE) -> Path:
    """A table of frames of RED."""
    lines = ["FrameNo,Timecode,Timestamp,Aperture,Focus Distance,Focal Length,Cooke"]
    lines[0] = lines[0].replace("Cooke", "Cooke Metadata")
    for at, focus in enumerate(focus_mm or (410,)):
        lines.append(f"{at},23:17:21:{at:02d},,5.600000,{focus},40,{cooke}")
    return _written(folder / "red.csv", "\r\n".join(lines))


def red_static(folder: Path, sensor: str = "MONSTRO 8K VV") -> Path:
    """The static table of RED, whose column Aperture stands twice."""
    return _written(
        folder / "static.csv",
        "Clip Name,Camera Model,Camera PIN,Sensor Name,Frame Width,Frame Height,"
        "Aperture,Lens Name,Aperture\n"
        f"A001,RANGER,130,{sensor},8192,4320,F5.6,40mm T1.5,\n",
    )


def sony(folder: Path, *apertures: str) -> Path:
    """A table of Sony VENICE."""
    lines = [
        '"Timecode","Clip Name","Lens Model","Lens Serial","Focal Length (mm)",'
        '"Aperture","Focus Distance (ft)","Camera Model"'
    ]
    for at, aperture in enumerate(apertures or ("T 2 3/10",)):
        lines.append(f'"16:47:04:{at:02d}","D1","S7i","","32","{aperture}","10","M"')
    return _written(folder / "sony.csv", "\n".join(lines))


def canon(folder: Path, metres: float = 0.5, mode: int = 2, stop: str = "45/10"):
    """A table of frames of Canon."""
    bits = struct.pack(">f", metres).hex().upper()
    return _written(
        folder / "canon.csv",
        "Timecode,FocusPosition,FocalLength,ApertureNumber,ApertureMode\n"
        f"0:00:00:00,{bits},180/10,{stop},{mode}\n",
    )


def blackmagic(folder: Path, *distances: str) -> Path:
    """A text of Blackmagic."""
    blocks = ["Clip Metadata\nlens_type: Cooke 50mm\nanamorphic: 2x\n"]
    for at, distance in enumerate(distances or ("991mm",)):
        blocks.append(
            f"Frame {at} Metadata\naperture: T2.3\nfocal_length: 50mm\n"
            f"distance: {distance}\nshutter_value: 180°\n"
        )
    return _written(folder / "clip.txt", "\n".join(blocks))


ALE_HEAD = "Heading\nFIELD_DELIM\tTABS\nFPS\t24\n\nColumn\n"
ALE_COLUMNS = "Name\tStart\tEnd\tFocal Length\tT-Stop\tFocus Distance\tLens"
ALE_CLIPS = (
    "A001C001.mov\t01:00:00:00\t01:00:04:00\t50mm\tT2.8\t2.0 m\tBiotar",
    "A001C002.mov\t01:00:10:00\t01:00:14:00\t50\t4\t4'11\"\tBiotar",
)


def ale(folder: Path, *clips: str, columns: str = ALE_COLUMNS) -> Path:
    """An Avid Log Exchange file."""
    rows = "\n".join(clips or ALE_CLIPS)
    return _written(folder / "A001.ale", f"{ALE_HEAD}{columns}\n\nData\n{rows}\n")


def sony_xml(folder: Path, lens: str = "S7i-32   ") -> Path:
    """The XML beside a clip of VENICE."""
    return _written(
        folder / "D001C005M01.XML",
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        "<NonRealTimeMeta "
        'xmlns="urn:schemas-professionalDisc:nonRealTimeMeta:ver.2.10">\n'
        '<Duration value="588"/>\n'
        '<Device manufacturer="Sony" modelName="AXS-R7" serialNo="00010604"/>\n'
        '<Camera manufacturer="Sony" modelName="MPC-3610" serialNo="0010201"/>\n'
        f'<Lens manufacturer="" modelName="{lens}"/>\n</NonRealTimeMeta>\n',
    )


def mosys_block(field: int, value: float | bytes) -> bytes:
    """A block of five bytes: a number, or four bytes as they are."""
    packed = value if isinstance(value, bytes) else struct.pack(">f", value)
    return bytes([field]) + packed


def mosys_packet(*blocks: bytes) -> bytes:
    """A packet of Mo-Sys F4."""
    head = bytes([0xF4, 0, len(blocks), 0x77])
    body = head + b"".join(blocks)
    return body + bytes([(0x40 - sum(body)) % 256])


def mosys(folder: Path, *focus_m: float, stop: float | None = 2.8) -> Path:
    """A recording of Mo-Sys F4, from 15:03:47:02 on, as its own recordings have it."""
    packets = []
    for at, metres in enumerate(focus_m or (2.5, 4.0)):
        blocks = [mosys_block(0x53, 1517.7), mosys_block(0x57, 1 / metres)]
        blocks += [] if stop is None else [mosys_block(0x60, stop)]
        timecode = bytes.fromhex("203c3bc2")[:3] + bytes([0xC2 + at])
        packets.append(mosys_packet(*blocks, mosys_block(0xF8, timecode)))
    (folder / "shot.f4").write_bytes(b"".join(packets))
    return folder / "shot.f4"


def chan(folder: Path, **fov_deg: float) -> Path:
    """A .chan of frames named as f1001=30.0."""
    lines = [f"{name[1:]} 0 1.5 -3 0 90 0 {fov}" for name, fov in fov_deg.items()]
    return _written(folder / "camera.chan", "\n".join(lines) + "\n")


def nuke(folder: Path, *knobs: str, node: str = "Camera2", name="Camera1") -> Path:
    """A script with a camera among other nodes."""
    body = "\n ".join([*knobs, f"name {name}", "xpos -10"])
    text = (
        "#! Nuke\nversion 14.0 v1\nBlur {\n size {{curve x1 9 x9 12}}\n name Blur1\n}\n"
        f"{node} {{\n inputs 0\n {body}\n}}\n"
    )
    return _written(folder / "shot.nk", text)


def _written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8", newline="")
    return path
