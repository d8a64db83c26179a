"""Frames through a lens, from the plate to the finished file."""
