"""All views of a shoot in one small model in which every statement is a prior.

A pinhole with two radial terms sees flat targets; only the middle of the frame is
looked at, where that is enough of a lens. With f the stated focal length and v the
vergence 1/(D - f) of the focus distance D, the principal distance of a state is

    c = f exp(a) (1 + f v) exp(m f v + b),

a for the focal length and m f v + b for the breathing that a thin lens does not have.
By first-order optics m = 1 / m_p - 1 of a lens that moves as a whole, m_p its pupil
magnification: 2.2 of a telephoto. Where elements move against each other the focal
length changes in proportion to vergence too: m is 4 of a zoom that focuses by its front
group. So all states of a focal length share m, and b is what is left. The
entrance pupil lies e in front of the sensor, so that a target stated at distance D lies
D - e from it. The pitch of a target is its stated one times exp(p). Widths of the
priors are those of the statements: a focal length is good to 3 %, a pitch to 0.2 %, a
tape measure to a centimetre and half a percent; views that state one distance share
most of the tape's error. Of an anamorphic lens x is multiplied by its nominal squeeze
times exp(q) at each focus distance, and its entrance pupil lies a length g before that
of y.

Neighbouring points share what the model leaves, so a view counts as `_INDEPENDENT`
points, whatever their number. Lengths are millimetres.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from lensfit.detect.observations import POINT
from lensfit.errors import FitError
from lensfit.fitting.chart_view import View
from lensfit.fitting.start_poses import pose_from_homography

FOCAL_LENGTH_SD, PITCH_SD = 0.03, 0.002
_BREATHING_SD, _OTHER_BREATHING_SD = 1.0, 0.01
"""Of m and of b."""
DISTANCE_SD_MM, DISTANCE_SD = 10.0, 0.005
_OF_PLACE = 0.5
_OF_TAPE = (1 - _OF_PLACE**2) ** 0.5
"""What stands still is measured once: views that state one distance share most of its
error, and differ by how a target was put up again."""
PUPIL_DIAGONALS = 1.4, 1.0
"""Mean and deviation of the entrance pupil before the sensor, in diagonals of the
sensor, of lenses that are not much longer: it lies inside the lens."""
_PUPIL_SD_LONG = 0.5
"""Added to the deviation for each millimetre of focal length beyond a diagonal."""
RELEASED_SD = 2.0
_SQUEEZE_SD = 0.05
"""Logarithm: squeeze changes with focus."""
_RADIAL_SD, _CENTRE_SD = 0.12, 0.02
"""At the corner, relative; of the sensor's width."""
_MOST_POINTS = 64
_MOST_AT_ONCE = 50_000
"""Points predicted at a time: for few, calls of numpy take longer than what they do."""
_CENTRAL = 0.6
"""Of the half diagonal."""
_INDEPENDENT = 20.0
_LEAST_PX = 0.1
_FREE_OF_STATEMENTS = (
    "focal_length", "breathing", "other_breathing", "pitch", "squeeze",
)  # fmt: skip
_STEPS, _TOLERANCE = 30, 1e-4


@final
@dataclass(frozen=True, eq=False)
class _View:
    """One view: points on the target and on the sensor, mm."""

    take: View
    board: Float[np.ndarray, "points 2"]
    image_mm: Float[np.ndarray, "points 2"]
    normal: Float[np.ndarray, "points 2"]
    is_point: np.ndarray
    rotation: Float[np.ndarray, "3 3"]
    translation_mm: Float[np.ndarray, "3"]


@final
@dataclass(frozen=True, eq=False)
class _Stack:
    """All views as arrays, padded to the most points, and where each one's shared
    parameters stand: `scale` of (focal length, breathing, other breathing).

    Attributes
    ----------
    stated : Views whose distance is stated.
    share : Root of how many independent points one point counts as.
    """

    board_mm: Float[np.ndarray, "views points 2"]
    image_mm: Float[np.ndarray, "views points 2"]
    normal: Float[np.ndarray, "views points 2"]
    is_point: np.ndarray
    is_there: np.ndarray
    rotation: Float[np.ndarray, "views 3 3"]
    translation_mm: Float[np.ndarray, "views 3"]
    pixel_mm: Float[np.ndarray, "views 2"]
    sensor_width_mm: Float[np.ndarray, " views"]
    focal_mm: Float[np.ndarray, " views"]
    vergence_per_mm: Float[np.ndarray, " views"]
    distance_mm: Float[np.ndarray, " views"]
    share: Float[np.ndarray, " views"]
    stated: list[int]
    tape: np.ndarray
    pitch: np.ndarray
    pupil: np.ndarray
    radial: np.ndarray
    scale: np.ndarray
    cylinder: np.ndarray

    @classmethod
    def of(cls, views: Sequence["_View"], at: Mapping[tuple, int]) -> "_Stack":
        """The stack of some views, with the places of shared parameters by name."""
        takes = [view.take for view in views]
        counts = np.array([len(view.board) for view in views])
        states = [(take.focal_length_mm, take.focus_distance_mm) for take in takes]

        def padded(arrays: Iterable[np.ndarray]) -> np.ndarray:
            rows = [
                np.concatenate(
                    [one, np.zeros((counts.max() - len(one), *one.shape[1:]))]
                )
                for one in arrays
            ]
            return np.array(rows)

        return cls(
            board_mm=padded(v.board * v.take.pitch_mm for v in views),
            image_mm=padded(v.image_mm for v in views),
            normal=padded(v.normal for v in views),
            is_point=padded(v.is_point for v in views).astype(bool),
            is_there=np.arange(counts.max()) < counts[:, None],
            rotation=np.array([view.rotation for view in views]),
            translation_mm=np.array([view.translation_mm for view in views]),
            pixel_mm=np.array([_pixel_mm(take) for take in takes]),
            sensor_width_mm=np.array([take.sensor_size_mm[0] for take in takes]),
            focal_mm=np.array([f for f, _ in states]),
            vergence_per_mm=np.array(
                [0.0 if z is None else 1 / max(z - f, f) for f, z in states]
            ),
            distance_mm=np.array([take.target_distance_mm or np.nan for take in takes]),
            share=np.sqrt(np.minimum(_INDEPENDENT / counts, 1.0)),
            stated=[k for k, t in enumerate(takes) if t.target_distance_mm is not None],
            **_places(takes, at),
        )


def _places(takes: Sequence[View], at: Mapping[tuple, int]) -> dict[str, np.ndarray]:
    """Where the shared parameters of each view stand; -1 for what it does not have."""
    states = [(take.focal_length_mm, take.focus_distance_mm) for take in takes]
    names = {
        "tape": [[("tape", take.target_distance_mm)] for take in takes],
        "pitch": [[("pitch", take.target)] for take in takes],
        "pupil": [[("pupil", f)] for f, _ in states],
        "radial": [[("radial", f, 0), ("radial", f, 1)] for f, _ in states],
        "scale": [
            [("focal_length", f), ("breathing", f), ("other_breathing", f, z)]
            for f, z in states
        ],
        "cylinder": [[("squeeze", f, z), ("cylinder", f)] for f, z in states],
    }
    places = {
        key: np.array([[at.get(name, -1) for name in row] for row in rows])
        for key, rows in names.items()
    }
    return {k: v[:, 0] if v.shape[1] == 1 else v for k, v in places.items()}


@final
@dataclass(frozen=True)
class Solution:
    """The model at its least misfit.

    Attributes
    ----------
    chi_squared : Of points and statements.
    parameters : All of them.
    rms_px : Of the points.
    """

    chi_squared: float
    parameters: Float[np.ndarray, " parameters"]
    rms_px: float


@final
@dataclass
class JointModel:
    """The views, the names of the shared parameters, and the priors.

    Attributes
    ----------
    names : Of shared parameters, in order: ("focal_length", f), ("breathing", f),
        ("other_breathing", f, D), ("pupil", f), ("radial", f, k), ("centre", axis),
        ("pitch", target), ("tape", stated distance); of anamorphic lenses
        ("squeeze", f, D), beside the nominal one, and ("cylinder", f): how far the
        entrance pupil of the squeezed axis lies before that of the other, mm.
    """

    views: Sequence[_View]
    names: list[tuple] = field(default_factory=list)
    mean: Float[np.ndarray, " shared"] = field(default_factory=lambda: np.zeros(0))
    deviation: Float[np.ndarray, " shared"] = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        rows: dict[tuple, tuple[float, float]] = {
            ("centre", axis): (0.0, _CENTRE_SD) for axis in (0, 1)
        }
        for view in self.views:
            f, focus = view.take.focal_length_mm, view.take.focus_distance_mm
            rows[("focal_length", f)] = 0.0, FOCAL_LENGTH_SD
            rows[("breathing", f)] = 0.0, _BREATHING_SD
            rows[("other_breathing", f, focus)] = 0.0, _OTHER_BREATHING_SD
            diagonal = float(np.hypot(*view.take.sensor_size_mm))
            ahead, sd = (diagonal * part for part in PUPIL_DIAGONALS)
            sd += _PUPIL_SD_LONG * max(f - diagonal, 0.0)
            rows[("pupil", f)] = ahead / f, sd / f
            for k in (0, 1):
                corner = (diagonal / 2 / f) ** (2 * k + 2)
                rows[("radial", f, k)] = 0.0, _RADIAL_SD / corner
            if view.take.anamorphic:
                rows[("squeeze", f, focus)] = 0.0, _SQUEEZE_SD
                rows[("cylinder", f)] = 0.0, diagonal
            rows[("pitch", view.take.target)] = 0.0, PITCH_SD
            stated = view.take.target_distance_mm
            if stated is not None:
                rows[("tape", stated)] = 0.0, 1.0
        self.names = list(rows)
        self.mean, self.deviation = np.array(list(rows.values())).T
        self._at = {name: k for k, name in enumerate(self.names)}
        self._stack = _Stack.of(self.views, self._at)

    def of_takes(self, takes: Sequence[View]) -> "JointModel":
        """The model with other statements of the same views, whose poses are known."""
        views = zip(self.views, takes, strict=True)
        return JointModel([replace(view, take=take) for view, take in views])

    @property
    def stated(self) -> list[int]:
        """Views whose target's distance is stated."""
        return self._stack.stated

    def start(self) -> Float[np.ndarray, " parameters"]:
        """Shared parameters as stated, poses as they were found."""
        return np.concatenate([self.mean, np.zeros(6 * len(self.views))])

    def value(self, solution: Solution, name: tuple) -> float:
        """A shared parameter."""
        return float(solution.parameters[self._at[name]])

    def distance_mm(self, solution: Solution, k: int) -> float:
        """How far from the sensor the target of a view stands by the model."""
        return float(self._distances_mm(solution.parameters)[k])

    def _distances_mm(self, parameters: np.ndarray) -> Float[np.ndarray, "*sets views"]:
        shared, pose = self._parts(parameters)
        stack = self._stack
        depth = stack.translation_mm[:, 2] * (1 + pose[..., 5])
        return depth + stack.focal_mm * shared[..., stack.pupil]

    def solve(
        self,
        noise_px: float,
        released: Mapping[tuple, float] | None = None,
        distances: frozenset[int] = frozenset(),
        begin: np.ndarray | None = None,
    ) -> Solution:
        """The least misfit, by Levenberg's method.

        Parameters
        ----------
        noise_px : Standard deviation of a point.
        released : Shared parameters and how wide their priors are instead.
        distances : Views whose stated distance does not count.
        begin : Parameters to start from.
        """
        deviation = self.deviation.copy()
        for name, wide in (released or {}).items():
            deviation[self._at[name]] = wide
        at = self.start() if begin is None else begin
        damping, step_size = 1e-3, np.inf
        residual = self._residual(at, noise_px, deviation, distances)
        for _ in range(_STEPS):
            jacobian = self._jacobian(at, residual, noise_px, deviation, distances)
            normal, slope = jacobian.T @ jacobian, jacobian.T @ residual
            while True:
                damped = normal + damping * np.diag(np.diag(normal) + 1e-12)
                step = -np.linalg.solve(damped, slope)
                after = self._residual(at + step, noise_px, deviation, distances)
                if after @ after <= residual @ residual or damping > 1e8:
                    break
                damping *= 10
            step_size = residual @ residual - after @ after
            at, residual, damping = at + step, after, max(damping / 10, 1e-9)
            if step_size < _TOLERANCE * max(residual @ residual, 1.0):
                break
        return Solution(float(residual @ residual), at, self.rms_px(at))

    def rms_px(self, parameters: np.ndarray) -> float:
        """Of all points, over both axes together."""
        miss = self._points_px(parameters)[self._stack.is_there]
        return float(np.sqrt((miss**2).sum(1).mean()))

    def _parts(
        self, parameters: np.ndarray
    ) -> tuple[Float[np.ndarray, "*sets shared"], Float[np.ndarray, "*sets views 6"]]:
        shared, pose = np.split(parameters, [len(self.names)], axis=-1)
        return shared, pose.reshape(*pose.shape[:-1], -1, 6)

    def _points_px(
        self, parameters: Float[np.ndarray, "*sets parameters"]
    ) -> Float[np.ndarray, "*sets views points 2"]:
        """Predicted minus seen points; of lines, across them; of padding, anything."""
        shared, pose = self._parts(parameters)
        stack = self._stack
        flat = stack.board_mm * np.exp(shared[..., stack.pitch])[..., None, None]
        turn = Rotation.from_rotvec(pose[..., :3].reshape(-1, 3)).as_matrix()
        turn = turn.reshape(*pose.shape[:-1], 3, 3) @ stack.rotation
        depth = stack.translation_mm[:, 2:]
        at = (stack.translation_mm + pose[..., 3:] * depth)[..., None, :]
        seen = flat @ np.swapaxes(turn[..., :2], -1, -2) + at
        cylinder = np.insert(shared, shared.shape[-1], 0.0, -1)[..., stack.cylinder]
        squeeze, apart_mm = np.moveaxis(cylinder, -1, 0)
        apart_mm = np.stack([apart_mm, 0 * apart_mm], -1)
        depths = seen[..., 2:] + apart_mm[..., None, :]
        slope = seen[..., :2] / np.where(depths > 1, depths, 1.0)
        slope[..., 0] *= np.exp(squeeze)[..., None]
        r2 = (slope**2).sum(-1, keepdims=True)
        radial = np.moveaxis(shared[..., stack.radial], -1, 0)
        k1, k2 = radial[..., None, None]
        f, vergence = stack.focal_mm, stack.vergence_per_mm
        a, m, b = np.moveaxis(shared[..., stack.scale], -1, 0)
        c_mm = f * (1 + f * vergence) * np.exp(a + m * f * vergence + b)
        centre = shared[..., None, :2] * stack.sensor_width_mm[:, None]
        predicted = c_mm[..., None, None] * slope * (1 + r2 * (k1 + r2 * k2))
        miss = predicted + centre[..., None, :] - stack.image_mm
        miss = miss / stack.pixel_mm[:, None]
        across = (miss * stack.normal).sum(-1, keepdims=True) * stack.normal
        return np.where(stack.is_point[..., None], miss, across)

    def _residual(
        self,
        parameters: Float[np.ndarray, "*sets parameters"],
        noise_px: float,
        deviation: np.ndarray,
        distances: frozenset[int],
    ) -> Float[np.ndarray, "*sets residuals"]:
        """Of one set of parameters, or of many at once."""
        shared, _ = self._parts(parameters)
        stack = self._stack
        points = self._points_px(parameters) * (stack.share / noise_px)[:, None, None]
        points = points[..., stack.is_there, :].reshape(*shared.shape[:-1], -1)
        stated = [k for k in self.stated if k not in distances]
        apart = self._distances_mm(parameters)[..., stated] - stack.distance_mm[stated]
        apart = apart / np.hypot(
            DISTANCE_SD_MM, DISTANCE_SD * stack.distance_mm[stated]
        )
        apart = apart - _OF_TAPE * shared[..., stack.tape[stated]]
        off = (shared - self.mean) / deviation
        return np.concatenate([points, off, apart / _OF_PLACE], -1)

    def _jacobian(
        self,
        at: np.ndarray,
        residual: np.ndarray,
        noise_px: float,
        deviation: np.ndarray,
        distances: frozenset[int],
    ) -> np.ndarray:
        """By differences; a view's pose moves that view alone, so all move at once."""
        step = 1e-6
        shared, count = len(self.names), len(self.views)
        each = np.eye(shared + 6)
        moves = np.hstack([each[:, :shared], np.tile(each[:, shared:], count)])
        moved = at + step * moves
        at_once = max(1, _MOST_AT_ONCE // self._stack.is_there.size)
        after = [
            self._residual(moved[k : k + at_once], noise_px, deviation, distances)
            for k in range(0, len(moved), at_once)
        ]
        change = (np.concatenate(after) - residual) / step
        columns = np.zeros((len(residual), len(at)))
        columns[:, :shared] = change[:shared].T
        owner = self._owners(distances)
        for k in range(count):
            mine, first = owner == k, shared + 6 * k
            columns[mine, first : first + 6] = change[shared:, mine].T
        return columns

    def _owners(self, distances: frozenset[int]) -> np.ndarray:
        """Which view each residual is of; -1 for none."""
        sizes = [2 * len(view.board) for view in self.views]
        owner = np.repeat(np.arange(len(sizes)), sizes)
        of_distances = [k for k in self.stated if k not in distances]
        return np.concatenate(
            [owner, np.full(len(self.names), -1), of_distances]
        ).astype(int)


def joint_model(takes: Sequence[View]) -> JointModel | None:
    """The model of the views that have a pose; None of fewer than one."""
    views = [view for view in map(_view, takes) if view is not None]
    return JointModel(views) if views else None


def _view(take: View) -> _View | None:
    found = take.observations
    half_px = np.asarray(found.image_size_px) / 2
    pixel_mm = _pixel_mm(take)
    image = (found.points_px - half_px) * pixel_mm
    away = np.linalg.norm(image, axis=1) / np.linalg.norm(half_px * pixel_mm)
    good = np.flatnonzero(~found.overlapping & (away < _CENTRAL))
    if len(good) < 16:
        return None
    some = good[:: max(1, len(good) // _MOST_POINTS)]
    board = found.lattice[some] - np.round(found.lattice[some].mean(0))
    f, focus = take.focal_length_mm, take.focus_distance_mm
    c_mm = f if focus is None or focus <= 2 * f else f * (1 + f / (focus - f))
    try:
        pose = pose_from_homography(board * take.pitch_mm, image[some], c_mm, take.name)
    except FitError:
        return None
    return _View(
        take=take,
        board=board,
        image_mm=image[some],
        normal=np.nan_to_num(found.normal[some]),
        is_point=found.family[some] == POINT,
        rotation=np.asarray(pose.rotation),
        translation_mm=np.asarray(pose.translation_mm),
    )


def _pixel_mm(take: View) -> Float[np.ndarray, "2"]:
    """Of the picture without its nominal squeeze."""
    return np.asarray(take.pixel_mm) * [take.squeeze, 1.0]


def noise_of_model_px(model: JointModel) -> tuple[float, Solution]:
    """What the model leaves where no statement holds it, and that solution."""
    wide = {name: RELEASED_SD for name in model.names if name[0] in _FREE_OF_STATEMENTS}
    every = frozenset(range(len(model.views)))
    solution = model.solve(1.0, wide, every)
    return max(solution.rms_px, _LEAST_PX), solution
