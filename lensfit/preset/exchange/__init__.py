"""Lenses as other programs write them: one file per format, text in and out.

A reader takes a path and raises nothing but a `LensfitError`; a model evaluates its
published formula on sensor millimetres (origin at the sensor centre, x right, y down).
Nothing is fitted here: `lensfit.fitting.exchange` finds the coefficients.
"""
