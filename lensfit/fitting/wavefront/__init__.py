"""The wavefront fit: from the shape of every dot to aberrations and pupil."""
