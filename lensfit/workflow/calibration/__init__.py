"""What a calibration finds on photographs, and what is kept and reported of the fit."""
