"""Detection and fit on photographs, beside OpenCV, the truth and the machine."""
