"""Files to arrays and back; knows no optics."""
