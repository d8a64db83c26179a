"""Truth made by physics: an exact ray tracer that photographs charts.

Stands apart from lensfit: it shares no line with `lensfit.optics`, so a lens fitted to
its photographs is judged by light that the fitted model does not contain. Geometric
optics only: no diffraction, flare or ghosts. Everything is float64 numpy.

Frames, used throughout. Object space: x right, y down as the photographer sees it, z
the distance from the sensor plane into the scene, mm. Tracer: the same x and y, z from
the scene to the sensor, the sensor at z = 0. Sensor: x right, y down of the upright
photograph, so the optical image is turned by 180 degrees (sensor = - tracer).
Pixel (column 0, row 0) covers [0, 1) x [0, 1), row 0 on top.
"""
