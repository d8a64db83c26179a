"""The page of a calibration: a verdict in plain words, then its evidence."""
