"""Coefficients of other programs' models for a lens, and of ours for theirs."""
