"""One photograph judged within seconds, while the camera still stands there."""
