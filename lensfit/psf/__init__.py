"""The image of a point: from pupil to sensor, and onto pixels."""
