"""Write a preset as another program's lens, and report the residual.

One entry point, `export_preset`; formats that have tables (lensfun, OpenTrackIO,
Unreal) get every entry unless one is requested.
"""

from collections.abc import Callable
from functools import partial

from lensfit.errors import ExchangeError, LensfitError
from lensfit.exchange.brown_conrady import export_opencv
from lensfit.exchange.cycles_osl import export_cycles
from lensfit.exchange.export_request import Exported, ExportRequest
from lensfit.exchange.lensfun_lens import export_lensfun
from lensfit.exchange.mrcal import export_mrcal_opencv, export_mrcal_splined
from lensfit.exchange.nuke_script import export_nuke_maps, export_stmaps
from lensfit.exchange.opentrackio_lens import export_opentrackio
from lensfit.exchange.syntheyes import export_syntheyes
from lensfit.exchange.tde4_node import TDE4_FORMATS, export_tde4
from lensfit.exchange.unreal import export_unreal
from lensfit.exchange.usd_camera import export_usd
from lensfit.preset.scaled_look import unscaled_error

WRITERS: dict[str, Callable[[ExportRequest], Exported]] = {
    **{name: partial(export_tde4, model) for name, model in TDE4_FORMATS.items()},
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
FORMATS = tuple(WRITERS)


def export_preset(to: str, request: ExportRequest) -> Exported:
    """Write `request.preset` in the format `to`, one of `FORMATS`.

    Raises
    ------
    ExchangeError : The other program cannot hold this lens.
    PresetError : The preset does not reach the state.
    OutputError : The file cannot be written.
    """
    if to not in WRITERS:
        raise ExchangeError(
            f"{to!r} is no format", remedy=f"known are {', '.join(FORMATS)}"
        )
    try:
        return WRITERS[to](request)
    except LensfitError as error:
        own = unscaled_error(error)
        if own is error:  # which would be its own cause
            raise
        raise own from error
