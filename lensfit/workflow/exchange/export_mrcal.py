"""mrcal's camera models: OpenCV's eight or twelve coefficients, or splines."""

from lensfit.atomic import write_text_atomic
from lensfit.fitting.exchange.samples import Residual, residual_of
from lensfit.fitting.exchange.splined_fit import fit_splined
from lensfit.lens import Lens
from lensfit.preset.exchange.mrcal import SplinedMap, mrcal_text
from lensfit.preset.exchange.opencv import OpenCvMap
from lensfit.workflow.exchange.export import (
    Exported,
    ExportRequest,
    Nearness,
    described,
    exported,
    opencv_camera,
    principal_point,
    samples_pair,
)

_SAMPLES = 81
"""Across the frame; more than control points."""


def export_mrcal_opencv(request: ExportRequest) -> Exported:
    """LENSMODEL_OPENCV8, or as few or many coefficients as are worth it."""
    lens = request.lens()
    return _written(request, lens, *opencv_camera(lens, request.frame))


def export_mrcal_splined(request: ExportRequest) -> Exported:
    """LENSMODEL_SPLINED_STEREOGRAPHIC."""
    lens = request.lens()
    fit, judge = samples_pair(lens, request.frame, _SAMPLES)
    distance = float(lens.distortion.principal_distance_mm)
    made = fit_splined(fit, distance, principal_point(lens))
    return _written(request, lens, made, residual_of(made, judge))


def _written(
    request: ExportRequest,
    lens: Lens,
    camera: OpenCvMap | SplinedMap,
    residual: Residual,
) -> Exported:
    frame = request.frame
    comments = (
        described(request, lens),
        f"residual {residual} over {frame}",
        f"sensor width {frame.sensor_width_mm!r} mm",
    )
    write_text_atomic(request.out, mrcal_text(camera, comments))
    return exported(request, lens, (Nearness("distortion", residual),))
