"""A sequence of frames as the job of a render farm."""
