"""A kit of lenses: planned, checked and calibrated as one job."""
