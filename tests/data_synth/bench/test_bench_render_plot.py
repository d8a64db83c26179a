"""Error against time as a picture: every peer is on it."""

import numpy as np
from skimage.io import imread

from data_synth.bench.render.plot import peers_of, write_plot

ROWS = [
    {
        "set": "plate",
        "what": "PSNR, dB",
        "peers": {"no defocus": 24.7, "layered discs": 33.1, "without mattes": 36.8},
    },
    {
        "set": "plate",
        "what": "seconds",
        "peers": {"processor": 0.7, "layered discs": 0.8},
    },
]
CURVE = [
    {"tolerance": 1e-3, "seconds": 0.6, "psnr_db": 36.8},
    {"tolerance": 1e-2, "seconds": 0.3, "psnr_db": 35.4},
]


def test_peers_come_with_their_seconds_where_they_took_any():
    found = {"no defocus": (None, 24.7), "layered discs": (0.8, 33.1)}
    assert peers_of(ROWS) == found


def test_the_plot_is_a_picture_with_something_on_it(tmp_path):
    path = write_plot({"rows": ROWS, "curves": {"plate": CURVE}}, tmp_path)
    picture = imread(path)[..., :3]
    assert picture.shape[0] > 400
    assert np.mean(picture < 200) > 0.005
