"""Lines and corners photographed by real cameras, and lines traced through a lens."""

import json

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from lensfit.detect.corners import find_checkerboard
from lensfit.detect.lines import find_lines
from lensfit.io.image import read_photograph


def held_out_rms(found, degree=9):
    """Rms across the lines, px, of a smooth map fitted to the other half of samples."""
    low, high = found.lattice.min(0), found.lattice.max(0)
    u = 2 * (found.lattice - low) / (high - low) - 1
    x, y = (np.polynomial.chebyshev.chebvander(column, degree) for column in u.T)
    terms = [
        x[:, i] * y[:, j] for i in range(degree + 1) for j in range(degree + 1 - i)
    ]
    basis = np.stack(terms, -1)
    normal = found.normal
    design = np.hstack([basis * normal[:, :1], basis * normal[:, 1:]])
    place = (normal * found.points_px).sum(1)
    fitted = np.random.default_rng(0).random(len(found)) < 0.5
    weights = np.linalg.lstsq(design[fitted], place[fitted], rcond=None)[0]
    return np.sqrt(np.mean((place - design @ weights)[~fitted] ** 2))


def test_lines_of_a_real_chart_are_smooth_to_a_twentieth_of_a_pixel(data_dir):
    path = data_dir / "real/discorpy/line_pattern_01.jpg"
    found = find_lines(read_photograph(path))
    assert len(np.unique(found.lattice[found.family == 0, 0])) >= 40
    assert len(np.unique(found.lattice[found.family == 1, 1])) >= 34
    assert len(found) > 12000
    assert held_out_rms(found) < 0.05


def test_lines_traced_through_a_lens_lie_where_their_light_does(data_dir):
    folder = data_dir / "oracle/dg50"
    found = find_lines(read_photograph(folder / "lines_f8.exr"))
    truth = json.loads((folder / "lines_f8_truth.json").read_text())
    table = np.array(truth["crossings"])
    lattice = table[:, :2] * [1, -1]
    low = lattice.min(0)
    size = (np.ptp(lattice, axis=0) + 1).astype(int)
    order = np.lexsort(lattice.T[::-1])
    centroids = table[order, 10:16].reshape(*size, 3, 2)
    axes = [np.arange(n) + start for n, start in zip(size, low, strict=True)]

    def true_place(channel, lattice):
        return np.stack(
            [
                RectBivariateSpline(*axes, centroids[:, :, channel, axis]).ev(
                    *lattice.T
                )
                for axis in (0, 1)
            ],
            -1,
        )

    middle = found.lattice[
        np.linalg.norm(found.points_px - [1024, 768], axis=1).argmin()
    ]
    offsets = [(i, j) for i in range(-12, 13) for j in range(-12, 13)]
    probe = np.abs(found.lattice - middle).max(1) < 1
    errors = [
        np.abs(
            (
                (found.points_px - true_place(1, found.lattice + offset)) * found.normal
            ).sum(1)[probe]
        ).mean()
        for offset in offsets
    ]
    origin = np.array(offsets[int(np.argmin(errors))])
    for channel in range(3):
        place = true_place(channel, found.lattice + origin)
        error = ((found.channel_points_px[channel] - place) * found.normal).sum(1)
        for family in (0, 1):
            assert abs(error[found.family == family].mean()) < 0.002
        assert np.sqrt(np.mean(error**2)) < 0.02


@pytest.mark.slow
def test_every_corner_of_real_boards_is_found(data_dir):
    folder = data_dir / "real/udacity_wide"
    for path in sorted(folder.glob("*.jpg")):
        found = find_checkerboard(read_photograph(path))
        expected = (30, [7, 4]) if path.stem == "GOPR0055" else (48, [7, 5])
        assert (len(found), found.lattice.max(0).tolist()) == expected, path.stem
