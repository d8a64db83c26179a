"""What lensfit writes into cameras of other programs, beside what their formats state.

A preset goes by the focal length on the zoom ring, for which USD has no attribute and
OpenTrackIO none that may change.
"""

USD_NOMINAL = "lensfit:nominalFocalLengthMm"
"""Attribute of a USD camera: focal length as on the ring, mm."""
CUSTOM_MARK = "custom: lensfit layout 1"
"""Line of an OpenTrackIO sample's calibration history."""
CUSTOM_LAYOUT = 1.0
"""First number of the sample's ``custom``; the nominal focal length in mm follows."""
