"""Write a preset as another program's lens, and report the residual.

One entry point, `export_preset`; formats that have tables (lensfun, OpenTrackIO) get
every entry unless one is requested.
"""

from collections.abc import Callable

from lensfit.errors import ExchangeError
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
)

FORMATS = (
    "nuke-radial",
    "nuke-anamorphic",
    "nuke-anamorphic-rescaled",
    "opentrackio",
    "opencv",
    "usd",
    "mrcal-opencv",
    "mrcal-splined",
    "unreal",
    "syntheyes",
    "lensfun",
    "stmap",
    "nuke-stmap",
    "cycles-osl",
)


def export_preset(to: str, request: ExportRequest) -> Exported:
    """Write `request.preset` in the format `to`, one of `FORMATS`.

    Raises
    ------
    ExchangeError : The other program cannot hold this lens.
    PresetError : The preset does not reach the state.
    OutputError : The file cannot be written.
    """
    from lensfit.exchange.brown_conrady import export_opencv
    from lensfit.exchange.cycles_osl import export_cycles
    from lensfit.exchange.export_tables import (
        export_lensfun,
        export_opentrackio,
    )
    from lensfit.exchange.mrcal import (
        export_mrcal_opencv,
        export_mrcal_splined,
    )
    from lensfit.exchange.nuke_stmap import export_nuke_maps, export_stmaps
    from lensfit.exchange.syntheyes import export_syntheyes
    from lensfit.exchange.tde4_node import TDE4_FORMATS, export_tde4
    from lensfit.exchange.unreal import export_unreal
    from lensfit.exchange.usd_camera import export_usd

    writers: dict[str, Callable[[ExportRequest], Exported]] = {
        "opentrackio": export_opentrackio,
        "opencv": export_opencv,
        "usd": export_usd,
        "mrcal-opencv": export_mrcal_opencv,
        "mrcal-splined": export_mrcal_splined,
        "unreal": export_unreal,
        "syntheyes": export_syntheyes,
        "lensfun": export_lensfun,
        "stmap": export_stmaps,
        "nuke-stmap": export_nuke_maps,
        "cycles-osl": export_cycles,
    }
    if to in TDE4_FORMATS:
        return export_tde4(TDE4_FORMATS[to], request)
    if to not in writers:
        raise ExchangeError(
            f"{to!r} is no format", remedy=f"known are {', '.join(FORMATS)}"
        )
    return writers[to](request)
