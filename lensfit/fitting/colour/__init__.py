"""Lateral colour, from detections that were measured in every channel."""
