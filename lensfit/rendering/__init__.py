"""Lens and plate to frame, forward only: `lensfit.render(rgb, depth_mm, lens)`."""
