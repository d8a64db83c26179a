"""White balance: the picture of a camera that takes another light for white.

Set to T kelvin and a tint, the camera shows light of that white (`illuminant`) as it
showed light of 6500 K before: a higher temperature makes the picture warmer, a positive
tint more magenta. The gain is von Kries', in the cone responses of Bradford, between
the two whites, put on in the plate's own primaries (its attribute `chromaticities`, or
Rec. 709 with D65), and scaled so that the luminance of a grey is kept: it neither makes
nor takes light from a grey. 6500 K and tint 0 are neutral. One-channel plates have no
colour, and stay.

References
----------
Bradford: K. M. Lam, thesis, 1985; the linear form of ICC.1. Primaries to XYZ: SMPTE
RP 177.
"""

import cv2
import numpy as np
from jaxtyping import Float, Float32

from lensfit.errors import LensfitError
from lensfit.rendering.look.illuminant import white_xyz, xyz_of_xy
from lensfit.rendering.look.light import is_finite

NEUTRAL_KELVIN = 6500.0
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
_LEAST_AREA = 1e-6
_BRADFORD = np.array(
    [
        [0.8951, 0.2664, -0.1614],
        [-0.7502, 1.7135, 0.0367],
        [0.0389, -0.0685, 1.0296],
    ]
)

Chromaticities = tuple[float, float, float, float, float, float, float, float]


def balance_matrix(
    kelvin: float, tint: float, chromaticities: Chromaticities = REC709
) -> Float[np.ndarray, "3 3"]:
    """New r, g, b from old.

    Parameters
    ----------
    kelvin : 1667 to 25000.
    tint : Positive gives magenta.
    chromaticities : x and y of red, green, blue and white.
    """
    to_xyz = xyz_from_rgb(chromaticities)
    old, new = (
        _BRADFORD @ white
        for white in (white_xyz(kelvin, tint), white_xyz(NEUTRAL_KELVIN))
    )
    adapted = np.linalg.solve(_BRADFORD, (new / old)[:, None] * _BRADFORD)
    matrix = np.linalg.solve(to_xyz, adapted @ to_xyz)
    return matrix / (to_xyz[1] @ matrix @ np.ones(3))


def xyz_from_rgb(chromaticities: Chromaticities) -> Float[np.ndarray, "3 3"]:
    """The matrix of some primaries, r = g = b = 1 having Y = 1; its second row is the
    luminance of each.

    Raises
    ------
    LensfitError : They are no primaries: they lie on a line, or one has no y.
    """
    x, y = np.array(chromaticities, float).reshape(4, 2).T
    area = np.linalg.det(np.stack([x, y, np.ones(4)])[:, :3])
    if not (abs(area) > _LEAST_AREA and (np.abs(y) > _LEAST_AREA).all()):
        numbers = ", ".join(f"{number:.4g}" for number in chromaticities)
        raise LensfitError(
            f"the chromaticities {numbers} span no colours",
            remedy="mend the attribute chromaticities in the header of the plate",
        )
    primaries = np.stack([x, y, 1 - x - y])[:, :3] / y[:3]
    return primaries * np.linalg.solve(primaries, xyz_of_xy(float(x[3]), float(y[3])))


def balanced(
    colour: Float32[np.ndarray, "height width 3"], matrix: Float[np.ndarray, "3 3"]
) -> Float32[np.ndarray, "height width 3"]:
    """A picture through a matrix; pixels that are NaN or infinite keep their bits."""
    result = cv2.transform(colour, matrix.astype(np.float32))
    if is_finite(colour):
        return result
    return np.where(np.isfinite(colour).all(-1, keepdims=True), result, colour)
