"""A lens inside Cycles, by its camera shader, beside the lens that lensfit knows."""
