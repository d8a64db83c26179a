"""Observations of a calibration, and its results in preset and report."""
