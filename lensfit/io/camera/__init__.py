"""Files beside the plate that know the camera: one reader for each kind.

A reader turns its file into a `CameraFile`, which tells for a frame what it says in
lensfit's units, and from which column or knob. Facts about the columns of ARRI, RED,
Sony, Canon and Blackmagic: the readers and samples of camdkit (SMPTE RIS OSVP),
https://github.com/SMPTE/ris-osvp-metadata-camdkit.
"""
