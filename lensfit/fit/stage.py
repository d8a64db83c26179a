"""Before the first step: scales, start poses, and how large a model may become.

The largest model that may be tried follows from the number of marks: a free field of
degree nine has a hundred coefficients, which a hundred marks cannot carry. The arrays
are laid out for the largest model of any state of the lens, so that one compiled
program fits them all.
"""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from lensfit.fit.adjust import Adjustment
from lensfit.fit.geometry import Frame
from lensfit.fit.parameters import Layout, Prior
from lensfit.fit.start import (
    Pose,
    focal_length_from_homographies,
    pose_from_homography,
)
from lensfit.fit.stated_distance import distance_ratio, scaled_poses
from lensfit.fit.take import Take, grouped
from lensfit.fit.views import Stack, board_of, observed_of, stack_takes

_TILT_RAD = 0.12
"""Views that differ by less do not fix a focal length."""
_WALK_TILT_RAD = 0.03
"""Views that differ by less say nothing of how the entrance pupil walks."""
_BEND_TILT_RAD = 0.35
"""Views that differ by less cannot tell a bent board from a distorting lens."""
_BEND_VIEWS = 5
_MARGIN = 1.05


@dataclass(frozen=True, eq=False)
class Start:
    """Everything the stages share.

    Attributes
    ----------
    takes : In the order of the arrays.
    stack : Their marks.
    frame : Scales of the parameters.
    largest : The model that these takes can carry.
    layout : Room for the largest model of any state of the lens.
    radius_mm : Of the dots of every take; 0 where marks are not dots.
    focal_length_free : Whether views tilt enough to determine the focal length.
    walk_shows : Whether they tilt enough to say something of how the pupil walks.
    half_angle_rad : From the axis to the furthest mark.
    notes : One sentence for each thing that was assumed.
    """

    takes: tuple[Take, ...]
    stack: Stack
    frame: Frame
    largest: Layout
    layout: Layout
    radius_mm: np.ndarray
    focal_length_free: bool
    walk_shows: bool
    half_angle_rad: float
    notes: tuple[str, ...]

    def adjustment(self, layout: Layout, prior: Prior) -> Adjustment:
        """An adjustment of this model at its start."""
        weight = self.stack.present.astype(float)
        return Adjustment(
            parameters=np.zeros(layout.size(len(self.takes))),
            layout=layout,
            frame=self.frame,
            prior=prior,
            stack=self.stack,
            radius_mm=self.radius_mm,
            shift_mm=np.zeros((*weight.shape, 2)),
            model_variance_mm2=self.stack.mm_per_px**2,
            weight=weight,
        )


def start_of(
    takes: list[Take], shown: list[Take], pupil_offset_mm: float | None = None
) -> Start:
    """Scales and start poses of the takes of one lens state.

    `shown` are the takes of all states of this lens, whose marks span the frame;
    `pupil_offset_mm` is the entrance pupil's place, if known.
    """
    focal_mm, notes = _stated_focal_length(takes)
    poses = [_pose(take, focal_mm) for take in takes]
    focal_mm, poses, of_distance = scaled_poses(takes, poses, focal_mm, pupil_offset_mm)
    apertures = [_aperture(take, _apertures(takes)) for take in takes]
    whole = _whole_boards(takes)
    stack = stack_takes(takes, poses, apertures, whole)
    radius = float(np.hypot(*takes[0].sensor_size_mm)) / 2
    squeeze = np.log(takes[0].squeeze)
    observed = np.concatenate([observed_of(take) for take in shown])
    box = np.array([observed.min(0), observed.max(0)]) / radius * _MARGIN
    furthest = float(np.hypot(*observed.T).max())
    frame = Frame(
        stated_focal_length_mm=jnp.asarray(focal_mm),
        reference_radius_mm=jnp.asarray(radius),
        stated_squeeze=jnp.asarray([squeeze, 0.0]),
        valid_radius=jnp.asarray(furthest / radius * _MARGIN),
        box=jnp.asarray(box * np.exp([squeeze / 2, -squeeze / 2])),
        board_distance_mm=_board_distance_mm(takes, poses),
    )
    bend, stretch = _board_degrees(takes, any(whole), poses)
    largest = replace(_lens_layout(takes), bend_degree=bend, stretch_degree=stretch)
    return Start(
        takes=tuple(takes),
        stack=stack,
        frame=frame,
        largest=largest,
        layout=_with_room(largest, grouped(shown)),
        radius_mm=np.array([_dot_radius_mm(take) for take in takes]),
        focal_length_free=_views_tilt(poses),
        walk_shows=not takes[0].anamorphic and _tilt_rad(poses) > _WALK_TILT_RAD,
        half_angle_rad=float(np.arctan(furthest / focal_mm)),
        notes=(*notes, *of_distance),
    )


def _stated_focal_length(takes: list[Take]) -> tuple[float, list[str]]:
    stated = takes[0].focal_length_mm
    found = None
    if len(takes) >= 3:
        found = focal_length_from_homographies(
            [board_of(t) for t in takes], [_unsqueezed_mm(t) for t in takes]
        )
    meant = _focal_length_meant(takes, found)
    ratio = found / meant if found is not None else 1.0
    if found is not None and 0.2 < ratio < 5 and abs(ratio - 1) > 0.3:
        note = (
            f"the photographs have a principal distance near {found:.3g} mm, "
            f"not the stated {stated:g} mm"
        )
        return found, [note]
    return meant, []


def _focal_length_meant(takes: list[Take], found: float | None) -> float:
    """The geometric mean of both axes' focal lengths, from what the barrel says.

    Anamorphic lenses are engraved with the focal length of the axis that is not
    squeezed; some sources state the mean. Tilted views (`found`) or measured distances
    tell which; without either it is the engraving.
    """
    stated, squeeze = takes[0].focal_length_mm, takes[0].squeeze
    readings = [stated / max(squeeze, 1 / squeeze) ** 0.5, stated]
    measured = [(t, t.target_distance_mm) for t in takes if t.target_distance_mm]
    if not takes[0].anamorphic or (found is None and not measured):
        return readings[0]

    def contradiction(focal_mm: float) -> float:
        if found is not None:
            return abs(np.log(found / focal_mm))
        ratios = [
            distance_ratio(
                said_mm, float(_pose(take, focal_mm).translation_mm[2]), focal_mm
            )
            for take, said_mm in measured
        ]
        return abs(np.log(max(float(np.median(ratios)), 1e-9)))

    return min(readings, key=contradiction)


def _pose(take: Take, focal_mm: float) -> Pose:
    return pose_from_homography(
        board_of(take), _unsqueezed_mm(take), focal_mm, take.name
    )


def _unsqueezed_mm(take: Take) -> np.ndarray:
    """Where the marks would be on a sensor behind a spherical lens."""
    return observed_of(take) * np.sqrt([take.squeeze, 1 / take.squeeze])


def _board_distance_mm(takes: list[Take], poses: list[Pose]) -> Array:
    """From the entrance pupil, of the boards whose distance was measured, or of all."""
    ahead = np.array([pose.translation_mm[2] for pose in poses])
    measured = np.array([take.target_distance_mm is not None for take in takes])
    return jnp.asarray(np.median(ahead[measured] if measured.any() else ahead))


def _apertures(takes: list[Take]) -> list[float]:
    """The f-numbers that are told apart, smallest aperture first.

    None, where marks are chief rays, which no aperture shifts.
    """
    if any(t.chief_rays for t in takes):
        return []
    return sorted({t.f_number for t in takes if t.f_number}, reverse=True)[:4]


def _aperture(take: Take, numbers: list[float]) -> int:
    if take.f_number is None or not numbers:
        return 0
    return int(np.argmin([abs(take.f_number - n) for n in numbers]))


def _whole_boards(takes: list[Take]) -> list[bool]:
    """Takes whose lattice has the extent that most takes of that target have."""
    extents = [
        (t.target, *np.round(np.ptp(t.observations.lattice, axis=0)).astype(int))
        for t in takes
    ]
    commonest = max(extents, key=extents.count)
    if extents.count(commonest) < 3:
        return [False] * len(takes)
    return [extent == commonest for extent in extents]


def _lens_layout(takes: list[Take]) -> Layout:
    """The largest model of the lens, without errors of the board."""
    marks = sum(len(t.observations) for t in takes)
    degrees = ((10_000, 11), (1500, 9), (600, 7), (300, 5))
    return Layout(
        radial=6 if marks >= 200 else 3,
        free_degree=next((d for n, d in degrees if marks >= n), 0),
        apertures=max(len(_apertures(takes)) - 1, 0),
        anamorphic=takes[0].anamorphic,
    )


def _board_degrees(
    takes: list[Take], whole: bool, poses: list[Pose]
) -> tuple[int, int]:
    """Of the board's bend, and of its errors within its plane."""
    each = sum(len(t.observations) for t in takes) / len(takes)
    if len(takes) < _BEND_VIEWS or _tilt_rad(poses) <= _BEND_TILT_RAD:
        return 0, 0
    bend = next((d for n, d in ((200, 4), (40, 2)) if each >= n), 0)
    return bend, 4 if whole and each >= 40 else 0


def _with_room(layout: Layout, states: list[list[Take]]) -> Layout:
    """A layout with room for the lens model of every state."""
    all_of_them = [layout, *map(_lens_layout, states)]
    return replace(
        layout,
        radial=max(one.radial for one in all_of_them),
        free_degree=max(one.free_degree for one in all_of_them),
        apertures=max(one.apertures for one in all_of_them),
    )


def _dot_radius_mm(take: Take) -> float:
    """Stated, or else from the image: diameter over pitch, both in pixels."""
    if take.mark_diameter_mm is not None:
        return take.mark_diameter_mm / 2
    diameter = take.observations.diameter_px
    if not np.isfinite(diameter).any():
        return 0.0
    spread = np.sqrt(np.linalg.det(np.cov(take.observations.points_px.T)))
    lattice = np.sqrt(np.linalg.det(np.cov(take.observations.lattice.T)))
    pitch_px = np.sqrt(spread / lattice) if lattice > 0 else np.inf
    return float(np.nanmedian(diameter) / pitch_px * np.mean(take.pitch_mm) / 2)


def _views_tilt(poses: list[Pose]) -> bool:
    return _tilt_rad(poses) > _TILT_RAD


def _tilt_rad(poses: list[Pose]) -> float:
    """Largest angle between two boards."""
    normals = np.stack([pose.rotation[:, 2] for pose in poses])
    return float(np.arccos(np.clip((normals @ normals.T).min(), -1, 1)))
