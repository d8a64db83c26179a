"""What an image of a point is still good for, by its relative error.

The error is the root of the summed squares of what is wrong, over that of the image.
"""

GOOD_BLUR = 0.1
"""Up to this it is barely visible."""
ROUGH_BLUR = 0.25
"""Up to this it is visible, and better than a disc."""
