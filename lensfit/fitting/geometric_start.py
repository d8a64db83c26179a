"""The start of a geometric fit: scales, start poses, and the largest model to test.

The number of detections limits the model: a free field of degree nine has a hundred
coefficients, which a hundred detections cannot determine. Arrays have room for the
largest model of any state of the lens, so that one compiled program serves all states.
"""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from lensfit.fitting.adjust import Adjustment
from lensfit.fitting.chart_view import View, views_by_state
from lensfit.fitting.geometry import Frame
from lensfit.fitting.parameters import Layout, Prior
from lensfit.fitting.start_poses import (
    Pose,
    focal_length_from_homographies,
    pose_from_homography,
    stated_scale,
)
from lensfit.fitting.statements import Facts, statements_of, views_sharing
from lensfit.fitting.usual_lens import (
    KnownPerspective,
    magnification_at,
    usual_pupil,
    usual_pupil_shift,
)
from lensfit.fitting.view_stack import Stack, board_of, observed_of, stack_takes

_TILT_RAD = 0.12
"""Views that differ by less do not determine a focal length."""
_ONE_PLANE_RAD, _ONE_PLANE_DEPTH = 0.01, 0.01
"""Angle between boards, and relative difference of their distances, up to which they
count as one board that was not moved."""
_BEND_TILT_RAD = 0.35
"""Views that differ by less do not distinguish a bent board from a distorting lens."""
_BEND_VIEWS = 5
_MARGIN = 1.05


@dataclass(frozen=True, eq=False)
class Start:
    """What all stages of a geometric fit use.

    Attributes
    ----------
    takes : The views, in the order of the arrays.
    stack : Their detections.
    frame : Scales of the parameters.
    largest : The largest model that these views can determine.
    layout : Layout with room for the largest model of any state of the lens.
    radius_mm : Radius of the dots of every view; 0 for corners and lines.
    focal_length_free : Whether views tilt enough to determine the focal length.
    pupil_shift_free : Whether views can determine the shift of the entrance pupil with
        field angle.
    half_angle_rad : From the axis to the outermost detection.
    notes : One sentence for each assumption.
    facts : Stated values.
    """

    takes: tuple[View, ...]
    stack: Stack
    frame: Frame
    largest: Layout
    layout: Layout
    radius_mm: np.ndarray
    focal_length_free: bool
    pupil_shift_free: bool
    half_angle_rad: float
    notes: tuple[str, ...]
    facts: Facts

    def adjustment(self, layout: Layout, prior: Prior) -> Adjustment:
        """The adjustment of a model, before the first step."""
        weight = self.stack.present.astype(float)
        return Adjustment(
            parameters=self.parameters(layout),
            layout=layout,
            frame=self.frame,
            prior=prior,
            stack=self.stack,
            radius_mm=self.radius_mm,
            shift_mm=np.zeros((*weight.shape, 2)),
            model_variance_mm2=self.stack.mm_per_px**2,
            weight=weight,
            statements=statements_of(
                self.facts,
                layout,
                float(self.frame.stated_focal_length_mm),
                np.asarray(self.stack.view.translation_mm)[:, 2],
            ),
        )

    def parameters(self, layout: Layout) -> np.ndarray:
        """Start values: zero, except for the known shift of the pupil with field angle,
        which may stay fixed."""
        parameters = np.zeros(layout.size(len(self.takes)))
        known_mm = self.facts.perspective.pupil_shift.shift_mm
        unit_mm = float(self.frame.stated_focal_length_mm)
        parameters[layout.blocks["pupil_shift"]] = known_mm / unit_mm
        return parameters


def start_of(
    views: list[View],
    all_views: list[View],
    perspective: KnownPerspective | None = None,
) -> Start:
    """Scales and start poses of the views of one lens state.

    `all_views` are the views of all states of this lens, whose detections span the
    frame; `perspective` is the prior from another state, if there is one.
    """
    focal_mm, facts, notes = _stated_focal_length(views, perspective)
    poses = [_pose(view, focal_mm) for view in views]
    ratio = stated_scale(facts, focal_mm, _depths_mm(poses)).ratio
    focal_mm = focal_mm * ratio
    poses = [_scaled_pose(pose, ratio) for pose in poses]
    apertures = [_aperture(view, _apertures(views)) for view in views]
    whole = _whole_boards(views)
    stack = stack_takes(views, poses, apertures, whole)
    radius = views[0].corner_mm
    squeeze = np.log(views[0].squeeze)
    observed = np.concatenate([observed_of(view) for view in all_views])
    box = np.array([observed.min(0), observed.max(0)]) / radius * _MARGIN
    furthest = float(np.hypot(*observed.T).max())
    frame = Frame(
        stated_focal_length_mm=jnp.asarray(focal_mm),
        reference_radius_mm=jnp.asarray(radius),
        stated_squeeze=jnp.asarray([squeeze, 0.0]),
        valid_radius=jnp.asarray(furthest / radius * _MARGIN),
        box=jnp.asarray(box * np.exp([squeeze / 2, -squeeze / 2])),
        board_distance_mm=_board_distance_mm(views, poses),
    )
    bend, stretch = _board_degrees(views, any(whole), poses)
    largest = replace(_lens_layout(views), bend_degree=bend, stretch_degree=stretch)
    return Start(
        takes=tuple(views),
        stack=stack,
        frame=frame,
        largest=largest,
        layout=_with_room(largest, views_by_state(all_views)),
        radius_mm=np.array([_dot_radius_mm(view) for view in views]),
        focal_length_free=_views_tilt(poses),
        pupil_shift_free=perspective is not None or _poses_differ(poses),
        half_angle_rad=float(np.arctan(furthest / focal_mm)),
        notes=tuple(notes),
        facts=facts,
    )


def _stated_focal_length(
    views: list[View], perspective: KnownPerspective | None
) -> tuple[float, Facts, list[str]]:
    """Principal distance for the start poses, stated values, and notes."""
    found = None
    if len(views) >= 3:
        found = focal_length_from_homographies(
            [board_of(t) for t in views],
            [_unsqueezed_mm(t) for t in views],
            views[0].focal_length_mm,
        )
    facts, notes = _facts_meant(views, perspective, found)
    stated_mm = facts.focal_length_mm
    ratio = found / stated_mm if found is not None else 1.0
    if found is not None and 0.2 < ratio < 5 and abs(ratio - 1) > 0.3:
        note = (
            f"the photographs have a principal distance near {found:.3g} mm, "
            f"not the stated {views[0].focal_length_mm:g} mm"
        )
        return found, facts, [*notes, note]
    return stated_mm, facts, notes


def _facts_meant(
    views: list[View], perspective: KnownPerspective | None, found: float | None
) -> tuple[Facts, list[str]]:
    """Stated values, with the interpretation of an anamorphic focal length that is most
    consistent with the rest.

    Anamorphic lenses are engraved with the focal length of the axis that is not
    squeezed; some sources state the geometric mean of both axes, or that of the
    squeezed axis. Tilted views (`found`) or measured distances decide; without either
    the engraving is assumed.
    """
    stated, squeeze = views[0].focal_length_mm, views[0].squeeze
    root = max(squeeze, 1 / squeeze) ** 0.5
    readings = [facts_of(views, ratio, perspective) for ratio in (root, 1.0, 1 / root)]
    measured = any(view.target_distance_mm for view in views)
    if not views[0].anamorphic or (found is None and not measured):
        return readings[0], []

    def contradiction(facts: Facts) -> float:
        focal_mm = facts.focal_length_mm
        if found is not None:
            return abs(np.log(found / focal_mm))
        depths_mm = _depths_mm([_pose(view, focal_mm) for view in views])
        return stated_scale(facts, focal_mm, depths_mm).cost

    meant = min(readings, key=contradiction)
    if meant is not readings[2]:
        return meant, []
    return meant, [
        f"focal_length_mm = {stated:g} is that of the squeezed axis: state "
        f"{stated * root**2:.4g}, that of the axis that is not squeezed, which is "
        "engraved on anamorphic lenses"
    ]


def facts_of(
    views: list[View],
    engraving: float = 1.0,
    perspective: KnownPerspective | None = None,
) -> Facts:
    """Stated values of the views of one lens state.

    Parameters
    ----------
    engraving : The stated focal length over the geometric mean of both axes'.
    perspective : Prior from another state; None for that of usual lenses.
    """
    focal_mm = views[0].focal_length_mm / engraving
    distances = [view.target_distance_mm or np.nan for view in views]
    measured = [distance for distance in distances if np.isfinite(distance)]
    focus_mm = views[0].focus_distance_mm
    if focus_mm is None:
        focus_mm = float(np.median(measured)) if measured else np.inf
    magnification = magnification_at(focal_mm, focus_mm)
    # The shift is a length: its effect on the image is unknown without a scale.
    stops = [view.f_number for view in views if view.f_number and measured]
    usual = KnownPerspective(
        usual_pupil(focal_mm * (1 + magnification)),
        usual_pupil_shift(focal_mm, min(stops, default=None), views[0].corner_mm),
    )
    return Facts(
        names=tuple(view.name for view in views),
        focal_length_mm=focal_mm,
        engraving=engraving,
        magnification=magnification,
        target_distance_mm=np.array(distances, float),
        shared=views_sharing([(t.target, t.target_distance_mm) for t in views]),
        perspective=perspective or usual,
        widths=views[0].widths,
    )


def _depths_mm(poses: list[Pose]) -> np.ndarray:
    return np.array([float(pose.translation_mm[2]) for pose in poses])


def _scaled_pose(pose: Pose, ratio: float) -> Pose:
    """The pose with its distance along the axis multiplied by `ratio`."""
    return Pose(pose.rotation, pose.translation_mm * [1.0, 1.0, ratio])


def _pose(view: View, focal_mm: float) -> Pose:
    return pose_from_homography(
        board_of(view), _unsqueezed_mm(view), focal_mm, view.name
    )


def _unsqueezed_mm(view: View) -> np.ndarray:
    """Positions of the detections if the lens were spherical."""
    return observed_of(view) * np.sqrt([view.squeeze, 1 / view.squeeze])


def _board_distance_mm(views: list[View], poses: list[Pose]) -> Array:
    """From the entrance pupil, of the boards whose distance was measured, or of all."""
    ahead = np.array([pose.translation_mm[2] for pose in poses])
    measured = np.array([view.target_distance_mm is not None for view in views])
    return jnp.asarray(np.median(ahead[measured] if measured.any() else ahead))


def _apertures(views: list[View]) -> list[float]:
    """The f-numbers with separate centroid shifts, smallest aperture first.

    Empty if the detections are chief rays, which do not depend on the aperture.
    """
    return [] if any(t.chief_rays for t in views) else _f_numbers(views)


def _f_numbers(views: list[View]) -> list[float]:
    """Smallest aperture first, as many as may have shifts of their own."""
    return sorted({t.f_number for t in views if t.f_number}, reverse=True)[:4]


def _aperture(view: View, numbers: list[float]) -> int:
    if view.f_number is None or not numbers:
        return 0
    return int(np.argmin([abs(view.f_number - n) for n in numbers]))


def _whole_boards(views: list[View]) -> list[bool]:
    """Which views show the lattice to the extent that most views of the target do."""
    extents = [
        (t.target, *np.round(np.ptp(t.observations.lattice, axis=0)).astype(int))
        for t in views
    ]
    commonest = max(extents, key=extents.count)
    if extents.count(commonest) < 3:
        return [False] * len(views)
    return [extent == commonest for extent in extents]


def _lens_layout(views: list[View]) -> Layout:
    """The largest model of the lens, without errors of the board."""
    count = sum(len(t.observations) for t in views)
    degrees = ((10_000, 11), (1500, 9), (600, 7), (300, 5))
    return Layout(
        radial=6 if count >= 200 else 3,
        free_degree=next((d for n, d in degrees if count >= n), 0),
        apertures=max(len(_apertures(views)) - 1, 0),
        anamorphic=views[0].anamorphic,
    )


def _board_degrees(
    views: list[View], whole: bool, poses: list[Pose]
) -> tuple[int, int]:
    """Degrees of the board's bend, and of its errors within its plane."""
    each = sum(len(t.observations) for t in views) / len(views)
    if len(views) < _BEND_VIEWS or _tilt_rad(poses) <= _BEND_TILT_RAD:
        return 0, 0
    bend = next((d for n, d in ((200, 4), (40, 2)) if each >= n), 0)
    return bend, 4 if whole and each >= 40 else 0


def _with_room(layout: Layout, states: list[list[View]]) -> Layout:
    """A layout with room for the lens model of every state, and for centroid shifts
    even where detections are chief rays by now: the program of the fit to centroids
    serves that to chief rays too."""
    all_of_them = [layout, *map(_lens_layout, states)]
    f_numbers = max(len(_f_numbers(views)) for views in states)
    return replace(
        layout,
        radial=max(one.radial for one in all_of_them),
        free_degree=max(one.free_degree for one in all_of_them),
        apertures=max(f_numbers - 1, 0),
    )


def _dot_radius_mm(view: View) -> float:
    """Stated radius, or diameter over pitch of the image in pixels; 0 of lines."""
    if view.observations.are_lines:
        return 0.0
    if view.mark_diameter_mm is not None:
        return view.mark_diameter_mm / 2
    diameter = view.observations.diameter_px
    if not np.isfinite(diameter).any():
        return 0.0
    spread = np.sqrt(np.linalg.det(np.cov(view.observations.points_px.T)))
    lattice = np.sqrt(np.linalg.det(np.cov(view.observations.lattice.T)))
    pitch_px = np.sqrt(spread / lattice) if lattice > 0 else np.inf
    return float(np.nanmedian(diameter) / pitch_px * np.mean(view.pitch_mm) / 2)


def _views_tilt(poses: list[Pose]) -> bool:
    return _tilt_rad(poses) > _TILT_RAD


def _poses_differ(poses: list[Pose]) -> bool:
    """Whether boards lie in more than one plane. In a single plane the shift of the
    pupil has the same effect as a tilt together with decentring."""
    depths_mm = _depths_mm(poses)
    farther = depths_mm.max() / depths_mm.min() - 1
    return _tilt_rad(poses) > _ONE_PLANE_RAD or farther > _ONE_PLANE_DEPTH


def _tilt_rad(poses: list[Pose]) -> float:
    """Largest angle between two boards."""
    normals = np.stack([pose.rotation[:, 2] for pose in poses])
    return float(np.arccos(np.clip((normals @ normals.T).min(), -1, 1)))
