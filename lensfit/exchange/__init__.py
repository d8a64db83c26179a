"""Lenses of other programs: one file per format, what it reads, writes and loses.

A format without blur or fall-off leaves them out, with a note; the residual of what it
does hold is in pixels of the frame.
"""
