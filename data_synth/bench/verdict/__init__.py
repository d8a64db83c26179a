"""Verdicts judged: wrong shoots must not end green, right ones must not be accused."""
