"""Detect the points of a shoot's takes, photograph by photograph.

Photographs are read and searched on two threads; a photograph that cannot be used is
set aside with its reason while the others go on.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from lensfit.detect.dot_diameter import DIAMETER_WIDTH, cut_rims, dot_diameter_mm
from lensfit.detect.dot_images import cut_dot_images
from lensfit.detect.find import observe
from lensfit.detect.line_measure import LINE_WIDTH_DEVIATION
from lensfit.detect.mosaic_seen import mosaic_seen
from lensfit.detect.observations import Observations
from lensfit.detect.orientation import numbered_as_on_chart
from lensfit.detect.overlay import draw_overlay
from lensfit.detect.sharpening import (
    EdgeProfile,
    Sharpening,
    edge_profile,
    sharpening_of,
    without_sharpening,
)
from lensfit.errors import DetectionError, ImageError, LensfitError
from lensfit.fitting.chart_view import View
from lensfit.io.image import (
    camera_state_of,
    is_linear_file,
    is_of_unknown_encoding,
    read_photograph,
)
from lensfit.mosaic import Mosaic
from lensfit.photograph import Photograph
from lensfit.progress import Progress, stopwatch
from lensfit.workflow.calibration.overlapping_blur import overlapping_blur_reasons
from lensfit.workflow.calibration.results_folder import OVERLAYS
from lensfit.workflow.calibration.small_photograph import SmallPhotograph, small_of
from lensfit.workflow.shoot.resolve_take import (
    ResolvedTake,
    pattern_of_target,
    resolve_take,
)
from lensfit.workflow.shoot.shoot_records import Shoot, Target
from lensfit.workflow.shoot.shoot_records import Take as ShootTake

_THREADS = 2
_LOOKED_AT = 8
"""Photographs, about, whose edges tell of sharpening."""


@dataclass(frozen=True, eq=False)
class Observed:
    """One take of the shoot, and what came of it.

    Attributes
    ----------
    image : Path as the shoot file has it.
    take : For the fit; None if the photograph could not be used.
    failed : Why not.
    overlay : Picture of the detections.
    small : The photograph itself, reduced; None if nothing is drawn.
    notes : What its photographer should know.
    sha256 : Hash of the photograph; empty if it could not be read.
    seconds : Reading, detection and drawing.
    mosaic_seen : The mosaic that the noise shows and is not stated.
    assumed_encoding : How a file was decoded that may as well hold linear samples,
        if not stated.
    target_not_found : Kind of the stated target, where the photograph shows none.
    sharpening : Of the camera, taken off wherever a mask explains it.
    """

    image: str
    target: str
    seconds: dict[str, float]
    resolved: ResolvedTake | None = None
    take: View | None = None
    failed: str | None = None
    overlay: Path | None = None
    small: SmallPhotograph | None = None
    notes: tuple[str, ...] = ()
    sha256: str = ""
    orientation: object = None
    mosaic_seen: Mosaic | None = None
    assumed_encoding: str | None = None
    target_not_found: str | None = None
    sharpening: Sharpening | None = None


# Detection multiplies tall matrices by a handful of columns on threads of its own:
# threads of BLAS on top of those only wait for each other, at three times the cost.
@threadpool_limits.wrap(limits=1, user_api="blas")
def observe_shoot(
    shoot: Shoot, out_dir: Path | None, progress: Progress
) -> list[Observed]:
    """Read every photograph of a shoot, detect its points, and draw them.

    Nothing is drawn if `out_dir` is None.
    """
    folder = None if out_dir is None else out_dir / OVERLAYS
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    names = _distinct_names([take.image for take in shoot.takes])
    done = 0
    progress("detect", 0, len(shoot.takes))
    results = []
    with ThreadPoolExecutor(_THREADS) as pool:
        sharpening = _sharpening_of_camera(shoot, pool)
        jobs = [
            pool.submit(
                _observe, shoot, take, folder and folder / f"{name}.png", sharpening
            )
            for take, name in zip(shoot.takes, names, strict=True)
        ]
        for job in jobs:
            results.append(job.result())
            done += 1
            progress("detect", done, len(jobs))
    return _with_mark_sizes(_without_overlaps(results))


def _with_mark_sizes(results: list[Observed]) -> list[Observed]:
    """Dots and lines whose size nobody stated as large as photographs of their chart
    show them, by the median."""
    takes = [one.take for one in results if one.take is not None]
    measured_mm: dict[str, list[float]] = {}
    for take in takes:
        if take.mark_diameter_mm is None:
            found = _mark_size_mm(take)
            if found is not None:
                measured_mm.setdefault(take.target, []).append(found)

    def sized(take: View | None) -> View | None:
        if take is None or take.target not in measured_mm:
            return take
        diameter_mm = float(np.median(measured_mm[take.target]))
        lines = take.observations.are_lines
        deviation = LINE_WIDTH_DEVIATION if lines else DIAMETER_WIDTH
        widths = replace(take.widths, diameter=deviation)
        return replace(take, mark_diameter_mm=diameter_mm, widths=widths)

    return [replace(one, take=sized(one.take)) for one in results]


def _mark_size_mm(take: View) -> float | None:
    """Diameter of dots or width of lines; None of corners, and where blur hides it."""
    seen = take.observations
    if seen.lines is not None:
        width = seen.lines.width_pitches
        return None if width is None else width * float(np.mean(take.pitch_mm))
    if seen.are_corners or take.dot_images is None:
        return None
    return dot_diameter_mm(seen, take.dot_images, take.pitch_mm)


def _without_overlaps(results: list[Observed]) -> list[Observed]:
    """Photographs of overlapping blur set aside with their reason."""
    reasons = overlapping_blur_reasons([one.take for one in results])
    return [
        one if why is None else replace(one, take=None, failed=f"{one.image}: {why}")
        for one, why in zip(results, reasons, strict=True)
    ]


def _sharpening_of_camera(shoot: Shoot, pool: ThreadPoolExecutor) -> Sharpening | None:
    """From the edges of some of the photographs."""

    def profile(take: ShootTake) -> EdgeProfile | None:
        try:
            photograph = photograph_of(shoot, take)
        except LensfitError:
            return None  # Whoever reads it next says why.
        return edge_profile(photograph)

    coded = [one for one in shoot.takes if not is_linear_file(one.image, one.encoding)]
    some = coded[:: max(1, len(coded) // _LOOKED_AT)]
    return sharpening_of(pool.map(profile, some))


def _observe(
    shoot: Shoot, take: ShootTake, overlay: Path | None, sharpening: Sharpening | None
) -> Observed:
    """One photograph; whatever goes wrong with it becomes its `failed`."""
    known: dict[str, Any] = {
        "image": take.image,
        "target": take.target or "",
        "sharpening": sharpening,
    }
    seconds = {"read": 0.0, "detect": 0.0, "overlay": 0.0}
    try:
        known |= _search_photograph(shoot, take, overlay, sharpening, known, seconds)
    except (LensfitError, ValueError, cv2.error) as error:
        name = Path(take.image).name
        known["failed"] = str(error) if name in str(error) else f"{take.image}: {error}"
        if isinstance(error, DetectionError) and take.target is not None:
            known["target_not_found"] = shoot.target_of(take).kind.replace("-", " ")
    return Observed(**known, seconds=seconds)


def _search_photograph(
    shoot: Shoot,
    take: ShootTake,
    overlay: Path | None,
    sharpening: Sharpening | None,
    known: dict[str, Any],
    seconds: dict[str, float],
) -> dict[str, Any]:
    """Read, search and draw; `known` keeps what was learnt before an error."""
    with _timed_stage(seconds, "read"):
        photograph = photograph_of(shoot, take)
        if sharpening is not None and sharpening.mask is not None:
            photograph = without_sharpening(photograph, sharpening.mask)
        known["sha256"] = photograph.sha256
        known["orientation"] = photograph.metadata.get("orientation")
        if take.encoding is None and is_of_unknown_encoding(photograph):
            known["assumed_encoding"] = photograph.encoding
        header = camera_state_of(photograph)
        resolved = resolve_take(shoot, take, header, photograph.size_px)
        known["resolved"] = resolved
    target = resolved.target
    with _timed_stage(seconds, "detect"):
        known["mosaic_seen"] = mosaic_seen(photograph)
        detections = detections_of(photograph, target, take.roi)
    if overlay is not None:
        with _timed_stage(seconds, "overlay"):
            draw_overlay(photograph, detections, overlay)
            known["overlay"] = overlay
            known["small"] = small_of(photograph)
    return {
        "take": _take_for_fit(take, resolved, detections, photograph),
        "notes": resolved.notes + _mosaic_notes(shoot, photograph) + detections.notes,
    }


def detections_of(
    photograph: Photograph,
    target: Target,
    roi: tuple[float, float, float, float] | None = None,
) -> Observations:
    """The detected points of a target, as every job that looks at photographs has them.

    Parameters
    ----------
    photograph : Scene-linear.
    roi : x0, y0, x1, y1 in pixels: where to look.

    Raises
    ------
    DetectionError : No such target is on the photograph.
    """
    found = observe(
        photograph,
        target.kind,
        polarity=target.polarity,
        roi=roi,
        board=_board_keys(target),
    )
    chart = pattern_of_target(target)
    if chart is not None:
        found = numbered_as_on_chart(photograph, found, chart) or found
    return found


def photograph_of(shoot: Shoot, take: ShootTake) -> Photograph:
    """The photograph of a take.

    Raises
    ------
    ImageError : As `read_photograph`; of one that is not there it names the shoot file.
    """
    path = shoot.image_path(take)
    try:
        return read_photograph(path, take.encoding, shoot.camera.mosaic)
    except ImageError as error:
        if path.exists():
            raise
        raise ImageError(
            error.what,
            where=path,
            remedy=f"correct its name in {shoot.path.name}, or say with --images which "
            "folder holds it",
        ) from error


@contextmanager
def _timed_stage(seconds: dict[str, float], stage: str) -> Iterator[None]:
    with stopwatch() as spent:
        yield
    seconds[stage] = spent["seconds"]


def _take_for_fit(
    take: ShootTake,
    resolved: ResolvedTake,
    detections: Observations,
    photograph: Photograph,
) -> View:
    dot_images = cut_dot_images(photograph, detections)
    return View(
        name=take.image,
        target=resolved.target.name,
        observations=detections,
        pitch_mm=resolved.target.pitch_xy_mm,
        mark_diameter_mm=resolved.target.hole_diameter_mm
        or resolved.target.line_width_mm,
        focal_length_mm=resolved.focal_length_mm,
        sensor_size_mm=resolved.sensor_size_mm,
        f_number=resolved.f_number,
        focus_distance_mm=resolved.focus_distance_mm,
        target_distance_mm=take.target_distance_mm,
        squeeze=take.anamorphic_squeeze or 1.0,
        dot_images=dot_images,
        rims=cut_rims(photograph, detections, dot_images),
    )


def _mosaic_notes(shoot: Shoot, photograph: Photograph) -> tuple[str, ...]:
    """What of the stated mosaic does not hold for this photograph."""
    if not shoot.camera.mosaic or photograph.mosaic:
        return ()
    why = "it is a raw file of another pattern"
    if photograph.chroma_subsampled:
        why = (
            "red and blue are stored at lower resolution; hand in the photograph as it "
            "was before JPEG"
        )
    return (f'the mosaic "{shoot.camera.mosaic}" is not made use of, since {why}',)


def _board_keys(target: Any) -> dict[str, Any]:
    keys = ("asymmetric", "squares", "dictionary", "marker_ratio")
    return {k: getattr(target, k) for k in keys if getattr(target, k) is not None}


def _distinct_names(images: list[str]) -> list[str]:
    """File stems, numbered where two photographs would share one."""
    names: list[str] = []
    for image in images:
        stem = Path(image).stem
        name, k = stem, 2
        while name in names:
            name, k = f"{stem}_{k}", k + 1
        names.append(name)
    return names
