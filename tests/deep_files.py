"""Deep OpenEXR files for tests."""

import numpy as np
import OpenEXR


def write_deep(path, counts, samples, attributes=None, compression=None):
    """Samples of all pixels, one after the other, as a deep file."""
    height, width = counts.shape
    ends = np.cumsum(counts.ravel())
    channels = {}
    for name, values in samples.items():
        pixels = np.empty(counts.size, object)
        for index, (end, count) in enumerate(zip(ends, counts.ravel(), strict=True)):
            pixels[index] = values[end - count : end].copy() if count else None
        channels[name] = pixels.reshape(height, width)
    corners = np.array([0, 0], np.int32), np.array([width - 1, height - 1], np.int32)
    header = {
        **(attributes or {}),
        "type": OpenEXR.deepscanline,
        "compression": compression or OpenEXR.ZIPS_COMPRESSION,
        "dataWindow": corners,
        "displayWindow": corners,
    }
    OpenEXR.File(header, channels).write(str(path))
    return path
