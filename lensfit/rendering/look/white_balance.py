"""White balance: a change of the white that the camera is balanced for.

Set to T kelvin and a tint, the camera shows light of that white (`white_balance`) as it
showed light of 6500 K before: a higher temperature makes the picture warmer, a positive
tint more magenta. The gain is von Kries', in the cone responses of Bradford, between
the two whites, applied in the plate's own primaries (its attribute `chromaticities`, or
Rec. 709 with D65), and scaled so that the luminance of a grey is kept. 6500 K and tint
0 are neutral. One-channel plates have no colour, and are not changed.

References
----------
Bradford: K. M. Lam, thesis, 1985; the linear form of ICC.1. Primaries to XYZ: SMPTE
RP 177.

The white that a camera is balanced for: colour temperature and tint to chromaticity.

From 5000 K on the CIE daylight locus, up to 4000 K the Planckian one, and between them
a mixture of both at equal luminance, by the temperature, as TM-30 has its reference
illuminant. The tint lies across, along the normal of the Planckian locus in the CIE
1960 diagram: 3000 to a unit of u, v; a positive one is a greenish light, for which a
balanced camera compensates with magenta.

References
----------
Daylight: CIE 15:2018, 4.1.2. Planckian locus: B. Kim et al., US patent 7024034 (cubics
in 1e3/T, 1667 to 25000 K). Mixture: ANSI/IES TM-30-20. Scale of the tint: Adobe DNG.
"""

import cv2
import numpy as np
from jaxtyping import Float, Float32

from lensfit.errors import LensfitError
from lensfit.rendering.look.light import is_finite

_PLANCKIAN_TO_K, _DAYLIGHT_FROM_K = 4000.0, 5000.0
_TINT_PER_UV = 3000.0
_STEP_K = 1.0


def white_xyz(kelvin: float, tint: float = 0.0) -> Float[np.ndarray, "3"]:
    """Tristimulus values of a white, Y = 1.

    Parameters
    ----------
    kelvin : 1667 to 25000.
    tint : Off the locus; positive is green.
    """
    xyz = _locus_xyz(kelvin)
    if tint == 0:
        return xyz
    normal = _green_of_locus(kelvin)
    return _xyz_of_uv(_uv_of_xyz(xyz) + normal * tint / _TINT_PER_UV)


def daylight_xy(kelvin: float) -> tuple[float, float]:
    """Chromaticity of a phase of daylight, 4000 to 25000 K."""
    t = 1e3 / kelvin
    if kelvin <= 7000:
        x = ((-4.6070 * t + 2.9678) * t + 0.09911) * t + 0.244063
    else:
        x = ((-2.0064 * t + 1.9018) * t + 0.24748) * t + 0.237040
    return x, (-3.0 * x + 2.870) * x - 0.275


def planckian_xy(kelvin: float) -> tuple[float, float]:
    """Chromaticity of a black body, 1667 to 25000 K."""
    t = 1e3 / kelvin
    if kelvin <= 4000:
        x = ((-0.2661239 * t - 0.2343589) * t + 0.8776956) * t + 0.179910
    else:
        x = ((-3.0258469 * t + 2.1070379) * t + 0.2226347) * t + 0.240390
    if kelvin <= 2222:
        y = ((-1.1063814 * x - 1.34811020) * x + 2.18555832) * x - 0.20219683
    elif kelvin <= 4000:
        y = ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867
    else:
        y = ((3.0817580 * x - 5.87338670) * x + 3.75112997) * x - 0.37001483
    return x, y


def xyz_of_xy(x: float, y: float) -> Float[np.ndarray, "3"]:
    """Tristimulus values of a chromaticity, Y = 1."""
    return np.array([x / y, 1.0, (1 - x - y) / y])


def _locus_xyz(kelvin: float) -> Float[np.ndarray, "3"]:
    span = _DAYLIGHT_FROM_K - _PLANCKIAN_TO_K
    daylight = float(np.clip((kelvin - _PLANCKIAN_TO_K) / span, 0, 1))
    if daylight == 0:
        return xyz_of_xy(*planckian_xy(kelvin))
    if daylight == 1:
        return xyz_of_xy(*daylight_xy(kelvin))
    both = xyz_of_xy(*planckian_xy(kelvin)), xyz_of_xy(*daylight_xy(kelvin))
    return (1 - daylight) * both[0] + daylight * both[1]


def _green_of_locus(kelvin: float) -> Float[np.ndarray, "2"]:
    """The normal of the Planckian locus in u, v that points to green."""
    ends = [
        _uv_of_xyz(xyz_of_xy(*planckian_xy(kelvin + step)))
        for step in (-_STEP_K, _STEP_K)
    ]
    along = ends[1] - ends[0]
    normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
    return normal if normal[1] > 0 else -normal


def _uv_of_xyz(xyz: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
    """CIE 1960."""
    x, y, z = xyz
    return np.array([4 * x, 6 * y]) / (x + 15 * y + 3 * z)


def _xyz_of_uv(uv: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
    u, v = uv
    x, y = np.array([3 * u, 2 * v]) / (2 * u - 8 * v + 4)
    return xyz_of_xy(float(x), float(y))


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


def balanced_picture(
    colour: Float32[np.ndarray, "height width 3"], matrix: Float[np.ndarray, "3 3"]
) -> Float32[np.ndarray, "height width 3"]:
    """A picture through a matrix; pixels that are NaN or infinite keep their bits."""
    result = cv2.transform(colour, matrix.astype(np.float32))
    if is_finite(colour):
        return result
    return np.where(np.isfinite(colour).all(-1, keepdims=True), result, colour)
