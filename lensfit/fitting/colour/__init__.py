"""Lateral colour, from marks that were measured in every channel."""
