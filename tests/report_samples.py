"""Plausible report dictionaries: a barrel lens seen in a few takes of a dot chart."""

from pathlib import Path

import cv2
import numpy as np

SENSOR_MM = (24.0, 18.0)
IMAGE_PX = (2000, 1500)
K1_PER_MM2 = -4e-4


def barrel_report(takes: int = 4, noise_px: float = 0.06, seed: int = 7) -> dict:
    """A whole report, as `calibrate` would write it for a 50 mm lens."""
    rng = np.random.default_rng(seed)
    return {
        "schema": "lensfit.report.2",
        "lens": {"name": "Barrel 50/1.4", "serial": "0042"},
        "camera": {
            "model": "Test camera",
            "sensor_width_mm": SENSOR_MM[0],
            "sensor_height_mm": SENSOR_MM[1],
            "image_width_px": IMAGE_PX[0],
            "image_height_px": IMAGE_PX[1],
        },
        "created": "2025-03-01T12:30:00+00:00",
        "versions": {"lensfit": "0.1.0", "jax": "0.7", "python": "3.11"},
        "rms_px": noise_px * 2**0.5,
        "held_out_rms_px": noise_px * 2**0.5 * 1.02,
        "points_detected": 1210 * takes,
        "points_used": 1200 * takes,
        "seconds": {
            "read": 0.4,
            "detect": 1.3,
            "compile": 6.1,
            "fit": 0.6,
            "write": 0.9,
            "whole": 8.25,
        },
        "notes": ["The chart was taken as flat."],
        "terms": _terms(),
        "takes": [_take(index, rng, noise_px) for index in range(takes)],
        "entries": [entry(50.0, 2000.0)],
        "blur": [_blur(takes)],
        "comparison": {"opencv_5_held_out_px": 0.16, "opencv_14_held_out_px": 0.11},
        "files": {"preset": "preset.json", "stmaps": ["stmaps/a_undistort.exr"]},
    }


def _terms() -> list[dict]:
    return [
        {
            "name": "radial_2",
            "kept": True,
            "value": K1_PER_MM2,
            "standard_deviation": 3e-7,
            "unit": "1/mm²",
            "reason": "held-out error falls from 4.1 to 0.09 px",
        },
        {
            "name": "principal_distance_mm",
            "kept": True,
            "value": [51.203, 51.19],
            "standard_deviation": [0.021, 0.022],
            "unit": "mm",
            "reason": "four views of a tilted chart",
        },
        {
            "name": "prism",
            "kept": False,
            "value": None,
            "standard_deviation": None,
            "unit": "1/mm",
            "reason": "held-out error does not improve",
        },
    ]


def _take(index: int, rng: np.random.Generator, noise_px: float) -> dict:
    x, y = np.meshgrid(np.linspace(25, 1975, 40), np.linspace(25, 1475, 30))
    x = x.ravel() + rng.normal(0, 8, x.size)
    y = y.ravel() + rng.normal(0, 8, y.size)
    errors = rng.normal(0, noise_px, (2, x.size))
    return {
        "name": f"take {index + 1}",
        "image": f"dots_{index + 1}.exr",
        "target": "dots",
        "focal_length_mm": 50.0,
        "f_number": 1.4 * 2 ** (index / 2),
        "focus_distance_mm": 2000.0,
        "target_distance_mm": 1998.0 + index,
        "points_detected": 1210,
        "points_used": 1200,
        "rms_px": noise_px * 2**0.5,
        "held_out_rms_px": noise_px * 2**0.5 * 1.02,
        "overlay": f"overlays/take_{index + 1}.png",
        "notes": [],
        "failed": None,
        "modelled": _modelled(index),
        "residuals": {
            "x_px": x.tolist(),
            "y_px": y.tolist(),
            "dx_px": errors[0].tolist(),
            "dy_px": errors[1].tolist(),
        },
    }


def _modelled(index: int) -> dict:
    names = ("photograph", "model", "left")
    return {name: f"model/take_{index + 1}_{name}.jpg" for name in names} | {
        "left_share": 0.05,
        "explained": 0.9987,
        "blur_measured": True,
    }


def _blur(takes: int) -> dict:
    return {
        "focal_length_mm": 50.0,
        "takes": [
            {
                "image": f"dots_{index + 1}.exr",
                "dots": 20,
                "misfit": 0.021 + 0.01 * index,
                "held_out_misfit": 0.032 + 0.01 * index,
            }
            for index in range(takes)
        ],
        "held_out_misfit": 0.035,
        "defocus": [
            {
                "focus_distance_mm": 2000.0,
                "target_distance_mm": 1998.0 + index,
                "image": None,
                "defocus_mm": -0.35 - 0.01 * index,
                "standard_deviation_mm": 0.003,
            }
            for index in range(takes)
        ],
        "blades": 8,
        "sign_known": True,
        "mirrored": False,
        "extrapolated": [],
        "converged": True,
        "not_seen": ["exit_pupil"],
    }


def failed_take(name: str, reason: str) -> dict:
    """A take that could not be used, with nothing but its reason."""
    return {"name": name, "image": f"{name}.exr", "failed": reason, "overlay": None}


def entry(focal_length_mm: float, focus_distance_mm: float) -> dict:
    """One preset entry: x' = x (1 + k1 r^2), fall-off cos^4, colour linear in r."""
    x = np.linspace(-SENSOR_MM[0] / 2, SENSOR_MM[0] / 2, 25)
    y = np.linspace(-SENSOR_MM[1] / 2, SENSOR_MM[1] / 2, 19)
    gx, gy = np.meshgrid(x, y)
    gain = K1_PER_MM2 * (gx**2 + gy**2)
    radius = np.linspace(0, 15.5, 32)
    sd = 0.004 + 0.05 * ((gx**2 + gy**2) / 225) ** 2
    return {
        "focal_length_mm": focal_length_mm,
        "focus_distance_mm": focus_distance_mm,
        "principal_distance_mm": 1.024 * focal_length_mm,
        "principal_point_mm": [0.05, -0.02],
        "distortion_centre_mm": [0.06, -0.03],
        "distortion_grid": {
            "x_mm": x.tolist(),
            "y_mm": y.tolist(),
            "dx_mm": (gx * gain).tolist(),
            "dy_mm": (gy * gain).tolist(),
        },
        "radial_profile": {
            "radius_mm": radius.tolist(),
            "distortion_percent": (100 * K1_PER_MM2 * radius**2).tolist(),
            "standard_deviation_percent": (0.002 * radius**2 / 10).tolist(),
        },
        "lateral_colour": {
            "radius_mm": radius.tolist(),
            "r_px": (0.03 * radius).tolist(),
            "b_px": (-0.02 * radius - 0.001 * radius**2).tolist(),
            "r_sd_px": (0.002 * radius).tolist(),
            "b_sd_px": (0.003 * radius).tolist(),
        },
        "fall_off": [_fall_off(stop, radius) for stop in (2.8, 1.4, 5.6)],
        "uncertainty_grid": {
            "x_mm": x.tolist(),
            "y_mm": y.tolist(),
            "sd_px": sd.tolist(),
        },
        "monotone": True,
        "round_trip_max_px": 1e-9,
        "overscan_percent": 3.2,
    }


def _fall_off(f_number: float, radius: np.ndarray) -> dict:
    light = np.cos(np.arctan(radius / 50)) ** 4 * (1 - 0.002 * radius**2 / f_number)
    return {
        "f_number": f_number,
        "radius_mm": radius.tolist(),
        "r": (light * (1 - 1e-4 * radius**2)).tolist(),
        "g": light.tolist(),
        "b": (light * (1 + 1e-4 * radius**2)).tolist(),
        "sd": (0.005 + 0 * radius).tolist(),
    }


def draw_overlays(report: dict, folder: Path, size_px: tuple[int, int]) -> None:
    """The pictures of takes that the report names: rings on a field of dots."""
    width, height = size_px
    for index, take in enumerate(report["takes"]):
        if not take.get("overlay"):
            continue
        picture = np.full((height, width, 3), 20 + 5 * index, np.uint8)
        for x in range(20, width, 40):
            for y in range(20, height, 40):
                cv2.circle(picture, (x, y), 6, (220, 220, 220), -1, cv2.LINE_AA)
                cv2.circle(picture, (x, y), 11, (80, 220, 120), 1, cv2.LINE_AA)
        said = take.get("modelled") or {}
        small = picture[:600, :800]
        drawn = {take["overlay"]: picture}
        names = [said.get(key) for key in ("photograph", "model", "left")]
        drawn |= {name: small for name in names if name}
        for name, made in drawn.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / name), made, [cv2.IMWRITE_JPEG_QUALITY, 40])
