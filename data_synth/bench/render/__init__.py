"""The renderer on a path-traced scene and on synthetic frames, beside its peers."""
