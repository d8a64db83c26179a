"""Calibrations of traced lenses, judged by the tracer, and what is judged beside."""
