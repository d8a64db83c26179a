"""UV maps, and the Nuke script that loads them."""

from lensfit.atomic import write_text_atomic
from lensfit.preset.exchange.nuke_stmap import MapSequence, nuke_stmap_text
from lensfit.workflow.exchange.export import (
    Exported,
    ExportRequest,
    described,
    exported,
)
from lensfit.workflow.stmaps import StmapFrame, WrittenStmaps, file_stem, write_stmaps


def export_stmaps(request: ExportRequest) -> Exported:
    """Both UV maps in the folder `request.out`, as `lensfit stmap` writes them."""
    written = _maps(request, request.out)
    return _exported(request, written, written.paths)


def export_nuke_maps(request: ExportRequest) -> Exported:
    """A Nuke script, and beside it the maps that it loads."""
    written = _maps(request, request.out.absolute().parent)
    label = f"{described(request, request.lens())}\nexact: UV maps, {request.frame}"
    files = map(MapSequence, written.paths)
    maps = dict(zip(("undistort", "redistort"), files, strict=True))
    text = nuke_stmap_text(
        maps, request.frame.size_px, label, per_channel=request.per_channel
    )
    write_text_atomic(request.out, text)
    return _exported(request, written, (request.out, *written.paths))


def _maps(request: ExportRequest, folder) -> WrittenStmaps:
    lens, frame = request.lens(), request.frame
    return write_stmaps(
        lens,
        StmapFrame(frame.size_px, frame.overscan_percent, frame.sensor_width_mm),
        folder,
        file_stem(request.preset.lens.name, lens),
        per_channel=request.per_channel,
        progress=request.progress,
    )


def _exported(request: ExportRequest, written: WrittenStmaps, paths) -> Exported:
    found = exported(
        request, request.lens(), (), has_colour=request.per_channel, paths=paths
    )
    needed = f"CG plates need {written.overscan_percent:.4f} % overscan in total"
    return Exported(found.paths, found.nearness, (*found.notes, *written.notes, needed))
