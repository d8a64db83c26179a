"""The camera and the knobs of a plate, with all their sources and their priority."""
