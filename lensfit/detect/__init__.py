"""Photograph of a target to observations: dots, lines and corners on a lattice."""
