"""Check one photograph within seconds, while the camera still stands there."""
