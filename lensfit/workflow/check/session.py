"""Photographs of one lens, checked one after the other as they are taken.

Each is read and searched exactly as `lensfit calibrate` will (`detections_of`), so what
is found here is what will be fitted. A session remembers the earlier views, with which
the side of focus is compared, and which views of the plan they are.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from lensfit.chart.layout import pattern_description
from lensfit.detect.chart_code import read_chart_code
from lensfit.detect.directional_blur import directional_blur
from lensfit.detect.find import KINDS
from lensfit.detect.lattice_map import LatticeMap, lattice_map
from lensfit.detect.observations import Observations
from lensfit.errors import DetectionError, LensfitError, ShootError
from lensfit.io.image import camera_state_of, read_photograph
from lensfit.io.metadata import CameraState
from lensfit.photograph import Photograph
from lensfit.workflow.calibration.observe import detections_of
from lensfit.workflow.check.check_records import Check, Level, Problem, worst_level
from lensfit.workflow.check.figures import (
    coverage_of,
    exposure_of,
    sharpness_of,
    write_check_picture,
)
from lensfit.workflow.check.focus_side import View, blurrier_in_focus, focus_side
from lensfit.workflow.check.motion import motion_of
from lensfit.workflow.check.photographs import (
    PlannedView,
    planned_views,
    view_of_photograph,
)
from lensfit.workflow.check.sentences import (
    coverage_problems,
    exposure_problems,
    focus_problems,
    motion_problems,
    sharpening_problems,
)
from lensfit.workflow.shoot.resolve_take import resolve_take, target_of_pattern
from lensfit.workflow.shoot.shoot_records import Shoot, Take, Target
from lensfit.workflow.statements.aspect_contradictions import size_contradiction

_UNSTATED_KINDS = ("dot-grid", "checkerboard", "line-grid")
"""Kinds that are tried where neither a shoot file nor the chart says which."""


@dataclass
class CheckSession:
    """The state of one session.

    Attributes
    ----------
    shoot : The plan; None without one.
    pictures : Folder to draw each check into; None draws nothing.
    views : Those checked so far, for comparison.
    judged : Level and file of the photographs that are views of the plan.
    """

    shoot: Shoot | None = None
    pictures: Path | None = None
    views: list[View] = field(default_factory=list)
    judged: dict[str, tuple[Level, Path]] = field(default_factory=dict)
    _hashes: dict[str, str] = field(default_factory=dict)
    _sizes_px: dict[str, tuple[Path, tuple[int, int]]] = field(default_factory=dict)
    _of_named_size: set[str] = field(default_factory=set)

    @threadpool_limits.wrap(limits=1, user_api="blas")
    def check(self, path: str | Path) -> Check:
        """Judge one photograph; one without a target comes back as "bad".

        Raises
        ------
        LensfitError : The file cannot be read, or the picture cannot be written.
        """
        path, began = Path(path), time.perf_counter()
        take, photograph, header = self._read(path)
        try:
            target, found = self._target_and_detections(photograph, take)
        except DetectionError as error:
            said = error.what
            problem = Problem("target", "bad", said, error.remedy or "shoot it again")
            seconds = time.perf_counter() - began
            name = None if take is None else take.image
            judged = Check(path, name, "bad", (problem,), seconds)
            return self._keep_check(judged)
        judged = self._judged_photograph(photograph, header, take, target, found)
        if self.pictures is not None:
            picture = self.pictures / f"{path.stem}_check.png"
            write_check_picture(photograph, found, judged, picture)
            judged = replace(judged, picture=picture)
        return self._keep_check(replace(judged, seconds=time.perf_counter() - began))

    @property
    def plan(self) -> Sequence[PlannedView]:
        """Every view of the plan and its state; none without a plan."""
        return () if self.shoot is None else planned_views(self.shoot, self._standing())

    def _standing(self) -> dict[str, tuple[Level, Path]]:
        """Views whose photograph was not deleted since."""
        judged = list(self.judged.items())
        return {name: one for name, one in judged if one[1].is_file()}

    def _keep_check(self, judged: Check) -> Check:
        if judged.take is not None:
            self.judged[judged.take] = judged.level, judged.image
        return judged

    def _read(self, path: Path) -> tuple[Take | None, Photograph, CameraState | None]:
        """The photograph in the encoding of its view, and what its header knows."""
        shoot = self.shoot
        mosaic = None if shoot is None else shoot.camera.mosaic
        take = None
        if shoot is not None:
            take = view_of_photograph(shoot, path, None, ())
        encoding = None if take is None else take.encoding
        photograph = read_photograph(path, encoding, mosaic)
        header = _header(photograph)
        if shoot is not None and take is None:
            taken = [n for n, (_, one) in self._standing().items() if one != path]
            take = view_of_photograph(shoot, path, header, taken)
            if take is not None and take.encoding not in (None, photograph.encoding):
                photograph = read_photograph(path, take.encoding, mosaic)
        return take, photograph, header

    def _target_and_detections(
        self, photograph: Photograph, take: Take | None
    ) -> tuple[Target, Observations]:
        """The target, and its detected points.

        Raises
        ------
        DetectionError : There is none.
        """
        roi = None if take is None else take.roi
        target = self._stated_target(take)
        if target is None:
            pattern = read_chart_code(photograph)
            if pattern is not None:
                target = target_of_pattern(pattern, pattern_description(pattern)[0])
        if target is not None:
            return target, detections_of(photograph, target, roi)
        return _best_kind_and_detections(photograph, roi)

    def _stated_target(self, take: Take | None) -> Target | None:
        """Of the view; of a photograph outside the plan, the only one there is."""
        if self.shoot is None:
            return None
        targets = self.shoot.targets
        if take is not None and take.target is not None:
            return targets[take.target]
        return next(iter(targets.values())) if len(targets) == 1 else None

    def _judged_photograph(
        self,
        photograph: Photograph,
        header: CameraState | None,
        take: Take | None,
        target: Target,
        found: Observations,
    ) -> Check:
        coverage = coverage_of(found)
        exposure = exposure_of(photograph, found)
        mapped = lattice_map(found)
        blur = sharpness = motion = side = sharper = None
        size = feature_pitches(target)
        if mapped is not None:
            blur = directional_blur(photograph, found, mapped, target.kind, size)
        if blur is not None:
            unknown = size is None and target.kind in ("dot-grid", "circle-grid")
            sharpness = sharpness_of(blur, photograph.size_px, unknown)
            squeezed = take is not None and (take.anamorphic_squeeze or 1.0) != 1.0
            motion = None if squeezed else motion_of(blur, photograph.size_px)
        if mapped is not None:
            centre = None if sharpness is None else sharpness.centre_px
            view = _view(photograph, header, take, target, mapped, centre)
            side = focus_side(view, self.views)
            blurrier = blurrier_in_focus(view, self.views)
            sharper = None if blurrier is None else blurrier.name
            self.views.append(view)
        problems = [*coverage_problems(coverage), *exposure_problems(exposure)]
        problems += [*sharpening_problems(photograph), *motion_problems(motion)]
        if side is not None:
            problems += focus_problems(side, sharpness, sharper)
        problems += self._beside_others(photograph, take)
        problems += self._refusals(photograph, header, take)
        low, high = found.lattice.min(0), found.lattice.max(0)
        return Check(
            image=photograph.path,
            take=None if take is None else take.image,
            level=worst_level(tuple(problems)),
            problems=tuple(problems),
            seconds=0.0,
            target=target.name,
            kind=target.kind,
            points=len(found),
            columns=(int(low[0]), int(high[0])),
            rows=(int(low[1]), int(high[1])),
            coverage=coverage,
            exposure=exposure,
            sharpness=sharpness,
            motion=motion,
            motion_measured=motion is not None,
            focus=side,
            notes=found.notes,
        )

    def _refusals(
        self, photograph: Photograph, header: CameraState | None, take: Take | None
    ) -> Iterator[Problem]:
        """What `lensfit calibrate` will not take of what is stated of a view."""
        if self.shoot is None or take is None or take.target is None:
            return
        try:
            resolve_take(self.shoot, take, header or CameraState(), photograph.size_px)
        except ShootError as error:
            remedy = error.remedy or "mend the shoot file"
            yield Problem("statement", "caution", error.what, remedy)

    def _beside_others(
        self, photograph: Photograph, take: Take | None
    ) -> Iterator[Problem]:
        """What is wrong with it only together with the other photographs."""
        yield from self._repetitions(photograph)
        yield from self._differing_sizes(photograph, take)

    def _repetitions(self, photograph: Photograph) -> Iterator[Problem]:
        """The same file under another name is not another view."""
        first = self._hashes.setdefault(photograph.sha256, photograph.path.name)
        if first != photograph.path.name:
            yield Problem(
                "repeated",
                "bad",
                f"holds the very exposure of {first}",
                "shoot another view: a copy adds nothing",
            )

    def _differing_sizes(
        self, photograph: Photograph, take: Take | None
    ) -> Iterator[Problem]:
        """Photographs of another size than most, as `lensfit calibrate` names them; one
        that came first is named beside the one that shows it. Those that were deleted
        since do not count."""
        name = str(photograph.path) if take is None else take.image
        self._sizes_px[name] = photograph.path, photograph.size_px
        there = {k: size for k, (path, size) in self._sizes_px.items() if path.exists()}
        differ = size_contradiction(there)
        if differ is None:
            return
        unusual = set(differ.images)
        if name in unusual:
            yield Problem("photograph_size", "bad", differ.text, differ.remedy)
        elif unusual - self._of_named_size:
            yield Problem("photograph_size", "caution", differ.text, differ.remedy)
        self._of_named_size |= unusual


def feature_pitches(target: Target) -> float | None:
    """Diameter of a dot or width of a line, in pitches; None if it is not stated."""
    size_mm = target.hole_diameter_mm or target.line_width_mm
    return None if size_mm is None else size_mm / float(np.mean(target.pitch_xy_mm))


def _best_kind_and_detections(
    photograph: Photograph, roi: tuple[float, float, float, float] | None
) -> tuple[Target, Observations]:
    """The kind of which most is found.

    Raises
    ------
    DetectionError : None of them is there.
    """
    best: tuple[Target, Observations] | None = None
    for kind in _UNSTATED_KINDS:
        target = Target(name=f"a {kind}", kind=kind, pitch_mm=1.0)
        try:
            found = detections_of(photograph, target, roi)
        except DetectionError:
            continue
        if kind != "line-grid":
            return target, found
        best = target, found
    if best is None:
        raise DetectionError(
            "no dot grid, checkerboard or line grid is found",
            where=photograph.path,
            remedy="check framing, focus and exposure, or name the target with --shoot "
            f"({', '.join(KINDS)})",
        )
    return best


def _header(photograph: Photograph) -> CameraState | None:
    try:
        return camera_state_of(photograph)
    except LensfitError:
        return None


def _view(
    photograph: Photograph,
    header: CameraState | None,
    take: Take | None,
    target: Target,
    mapped: LatticeMap,
    blur_px: float | None,
) -> View:
    """What later views are compared to."""
    middle = np.asarray(photograph.size_px, float) / 2
    cell = mapped.jacobians_px(mapped.lattice_at(middle)[None])[0]

    def stated(key: str) -> float | None:
        own = None if take is None else getattr(take, key)
        return own if own is not None or header is None else getattr(header, key)

    return View(
        name=photograph.path.name,
        target=target.name,
        focal_length_mm=stated("focal_length_mm"),
        f_number=stated("f_number"),
        focus_distance_mm=stated("focus_distance_mm"),
        target_distance_mm=None if take is None else take.target_distance_mm,
        image_size_px=photograph.size_px,
        cell_px=cell,
        blur_px=blur_px,
    )
