"""Deep OpenEXR files for tests."""

import numpy as np
import OpenEXR


def write_deep(path, counts, samples, attributes=None, compression=None, windows=None):
    """Samples of all pixels, one after the other, as a deep file; its data and display
    windows are those of the array unless they are given."""
    height, width = counts.shape
    ends = np.cumsum(counts.ravel())
    channels = {}
    for name, values in samples.items():
        pixels = np.empty(counts.size, object)
        for index, (end, count) in enumerate(zip(ends, counts.ravel(), strict=True)):
            pixels[index] = values[end - count : end].copy() if count else None
        channels[name] = pixels.reshape(height, width)
    windows = windows or [(0, 0, width - 1, height - 1)] * 2
    data, display = (np.array(w, np.int32).reshape(2, 2) for w in windows)
    header = {
        **(attributes or {}),
        "type": OpenEXR.deepscanline,
        "compression": compression or OpenEXR.ZIPS_COMPRESSION,
        "dataWindow": tuple(data),
        "displayWindow": tuple(display),
    }
    OpenEXR.File(header, channels).write(str(path))
    return path
