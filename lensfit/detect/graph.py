"""Lattice indices of detections that are joined by visible edges.

The corners of a checkerboard are joined by the edges between its squares, which can be
seen. Following those links needs neither a guess of the pitch nor a regular
neighbourhood: a handful of corners of a close board under fish-eye distortion, where
steps change by half from one to the next, is indexed as surely as a distant one. Links
are proposed between near neighbours, kept where the edge is seen, and walked breadth
first; each detection hands its two axes on to its neighbours, so that the axes may turn
across the frame. Detections joined by nothing (dots) are indexed by `detect.lattice`.
"""

from collections import deque
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

NEIGHBOURS = 16
FAINTEST_LINK = 0.4
"""Least edge strength relative to the second-best link of either end."""
ROUGHEST_LATTICE = 0.25
"""Largest `roughness` of anything that was a regular target."""
SAME_WAY_COSINE = 0.85
"""Of two links within about 32 degrees only the shorter is a lattice step."""

SHORTEST_STEP_PX = 2.0
LONGEST_STEP = 1.6
"""Largest ratio of two successive steps along a line."""

LinkStrength = Callable[
    [Float[np.ndarray, "links 2"], Float[np.ndarray, "links 2"]],
    Float[np.ndarray, " links"],
]


def find_links(
    points_px: Float[np.ndarray, "detections 2"], strength: LinkStrength
) -> Int[np.ndarray, "links 2"]:
    """Pairs of detections that are one lattice step apart.

    Parameters
    ----------
    points_px : Positions, pixels.
    strength : How surely an edge joins each start to each end; 0 or less for none.

    Returns
    -------
    Pairs of indices, smaller first.
    """
    count = min(NEIGHBOURS + 1, len(points_px))
    if count < 2:
        return np.zeros((0, 2), int)
    near = np.asarray(KDTree(points_px).query(points_px, count)[1])[:, 1:]
    start = np.repeat(np.arange(len(points_px)), count - 1)
    pairs = np.unique(np.sort(np.stack([start, near.ravel()], -1), 1), axis=0)
    apart = np.linalg.norm(points_px[pairs[:, 1]] - points_px[pairs[:, 0]], axis=1)
    pairs = pairs[apart > SHORTEST_STEP_PX]
    seen = strength(points_px[pairs[:, 0]], points_px[pairs[:, 1]])
    pairs, seen = pairs[seen > 0], seen[seen > 0]
    usual = _second_best(pairs, seen, len(points_px))
    kept = (seen[:, None] > FAINTEST_LINK * usual[pairs]).all(1)
    return _shortest_each_way(points_px, pairs[kept])


def _second_best(pairs: np.ndarray, seen: np.ndarray, detections: int) -> np.ndarray:
    """For each detection the strength of its second-best link, or of its only one."""
    best = np.zeros((detections, 2))
    order = np.argsort(seen)
    for end in (0, 1):
        for detection, value in zip(pairs[order, end], seen[order], strict=True):
            if value >= best[detection, 0]:
                best[detection] = value, best[detection, 0]
            elif value > best[detection, 1]:
                best[detection, 1] = value
    return np.where(best[:, 1] > 0, best[:, 1], best[:, 0])


def _shortest_each_way(points_px: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Drop links that pass beyond a nearer neighbour in the same direction."""
    step = points_px[pairs[:, 1]] - points_px[pairs[:, 0]]
    length = np.linalg.norm(step, axis=1)
    links = _links_of_points(pairs, len(points_px))
    dropped = np.zeros(len(pairs), bool)
    for detection, own in enumerate(links):
        own = np.array(sorted(own, key=lambda link: length[link]), int)
        away = np.where(pairs[own, 0] == detection, 1, -1)[:, None] * step[own]
        away /= length[own, None]
        same_way = np.tril(away @ away.T > SAME_WAY_COSINE, -1)
        dropped[own[same_way.any(1)]] = True
    return _without_leaps(points_px, pairs[~dropped])


def _without_leaps(points_px: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Drop links that leap over a detection that was not found.

    Such a link is about twice as long as the one that continues it at either end.
    """
    step = points_px[pairs[:, 1]] - points_px[pairs[:, 0]]
    length = np.linalg.norm(step, axis=1)
    leaps = np.zeros(len(pairs), bool)
    for detection, links in enumerate(_links_of_points(pairs, len(points_px))):
        own = np.array(links, int)
        away = np.where(pairs[own, 0] == detection, 1, -1)[:, None] * step[own]
        away /= length[own, None]
        for link, cosines in zip(own, away @ away.T, strict=True):
            opposite = own[cosines < -SAME_WAY_COSINE]
            if len(opposite) and length[link] > LONGEST_STEP * length[opposite].min():
                leaps[link] = True
    return pairs[~leaps]


def _links_of_points(pairs: np.ndarray, detections: int) -> list[list[int]]:
    links: list[list[int]] = [[] for _ in range(detections)]
    for link, (a, b) in enumerate(pairs):
        links[a].append(link)
        links[b].append(link)
    return links


def index_linked(
    points_px: Float[np.ndarray, "detections 2"], links: Int[np.ndarray, "links 2"]
) -> tuple[Int[np.ndarray, "detections 2"], Bool[np.ndarray, " detections"]]:
    """Lattice indices of the largest connected piece, i to the right and j down.

    Parameters
    ----------
    points_px : Positions, pixels.
    links : Pairs of detections one lattice step apart.

    Returns
    -------
    indices : Lattice coordinates counted from the smallest; 0 where not valid.
    valid : Detections that were reached, agree with most of their links and share their
        place with no other; none if all lie in one row.
    """
    seed, axes = _best_seed(points_px, links)
    indices, valid = _walk(points_px, links, seed, axes)
    valid = _consistent(indices, valid, links)
    indices[~valid] = 0
    if not valid.any() or (np.ptp(indices[valid], axis=0) == 0).any():
        valid[:] = False
    else:
        indices = _upright(points_px, indices, valid, links)
        indices[valid] -= indices[valid].min(0)
    return indices, valid


def roughness(
    indices: Int[np.ndarray, "detections 2"],
    points_px: Float[np.ndarray, "detections 2"],
) -> float:
    """Median bend between three detections in a row, relative to their distance.

    A photographed target, however distorted, bends by a few hundredths from one to the
    next; detections linked by chance bend at every step. Infinity if no three are in a
    row.
    """
    at = {tuple(place): k for k, place in enumerate(indices.tolist())}
    bends = []
    for (i, j), k in at.items():
        for di, dj in ((1, 0), (0, 1)):
            ends = at.get((i - di, j - dj)), at.get((i + di, j + dj))
            if None not in ends:
                before, after = points_px[ends[0]], points_px[ends[1]]
                length = np.linalg.norm(after - before) / 2
                bend = np.linalg.norm((before + after) / 2 - points_px[k])
                bends.append(bend / max(length, 1e-9))
    return float(np.median(bends)) if bends else np.inf


def _best_seed(points_px: np.ndarray, links: np.ndarray) -> tuple[int, np.ndarray]:
    """A detection of the largest piece with four links, and its axes by those links."""
    piece = np.arange(len(points_px))
    for _ in range(len(points_px)):
        lower = piece.copy()
        np.minimum.at(lower, links[:, 0], piece[links[:, 1]])
        np.minimum.at(lower, links[:, 1], piece[links[:, 0]])
        if (lower == piece).all():
            break
        piece = lower[lower]
    largest = piece == np.bincount(piece, minlength=len(piece)).argmax()
    degree = np.bincount(links.ravel(), minlength=len(points_px))
    middle = np.median(points_px[largest], axis=0)
    distance = np.linalg.norm(points_px - middle, axis=1)
    full = largest & (degree == degree[largest].max())
    seed = int(np.argmin(np.where(full, distance, np.inf)))
    others = links[(links == seed).any(1)].sum(1) - seed
    steps = points_px[others] - points_px[seed]
    if not len(steps):
        return seed, np.eye(2)
    first = steps[0]
    across = np.abs(steps @ first) / np.linalg.norm(steps, axis=1)
    second = steps[np.argmin(across)]
    if abs(np.linalg.det([first, second])) < 0.1 * np.linalg.norm(first) ** 2:
        second = np.array([-first[1], first[0]])
    return seed, np.stack([first, second])


def _walk(
    points_px: np.ndarray, links: np.ndarray, seed: int, axes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Breadth first from the seed; every detection inherits and updates the axes."""
    neighbours: list[list[int]] = [[] for _ in points_px]
    for a, b in links.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    indices = np.zeros((len(points_px), 2), int)
    reached = np.zeros(len(points_px), bool)
    reached[seed] = True
    queue = deque([(seed, axes)])
    while queue:
        detection, axes = queue.popleft()
        others = np.array(neighbours[detection], int)
        steps = points_px[others] - points_px[detection]
        along = np.linalg.solve(axes.T, steps.T).T
        axis = np.abs(along).argmax(1)
        own = axes.copy()
        for other, step, way, k in zip(others, steps, along, axis, strict=True):
            sign = 1 if way[k] > 0 else -1
            own[k] = sign * step
            if not reached[other]:
                indices[other] = indices[detection]
                indices[other, k] += sign
        for other in others[~reached[others]]:
            reached[other] = True
            queue.append((int(other), own))
    return indices, reached


def _consistent(
    indices: np.ndarray, reached: np.ndarray, links: np.ndarray
) -> np.ndarray:
    """Reached detections whose links are mostly single steps and whose place is
    theirs."""
    detections = len(indices)
    both = reached[links].all(1)
    step = np.abs(indices[links[:, 1]] - indices[links[:, 0]]).sum(1)
    good = np.zeros(detections)
    total = np.zeros(detections)
    for end in (0, 1):
        np.add.at(good, links[both, end], step[both] == 1)
        np.add.at(total, links[both, end], 1)
    valid = reached & (good > 0.5 * total)
    _, place, count = np.unique(
        np.where(valid[:, None], indices, np.arange(detections)[:, None] + 10**6),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    return valid & (count[place.ravel()] == 1)


def _upright(
    points_px: np.ndarray, indices: np.ndarray, valid: np.ndarray, links: np.ndarray
) -> np.ndarray:
    """Rename the axes so that i runs to the right and j down, unmirrored."""
    inside = links[valid[links].all(1)]
    step = (indices[inside[:, 1]] - indices[inside[:, 0]]).astype(float)
    pixels = points_px[inside[:, 1]] - points_px[inside[:, 0]]
    matrix = np.linalg.lstsq(step, pixels, rcond=None)[0]
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    direction = matrix / np.where(length > 0, length, 1.0)
    if abs(direction[1, 0]) > abs(direction[0, 0]):
        indices, direction = indices[:, ::-1].copy(), direction[::-1]
    right = 1 if direction[0, 0] > 0 else -1
    down = 1 if right * np.linalg.det(direction) > 0 else -1
    return indices * np.array([right, down])
