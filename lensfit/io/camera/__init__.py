"""Files beside the plate that describe the camera: one reader for each kind.

A reader turns its file into a `CameraFile`, which returns for a frame its values in
lensfit's units, and the column or knob of each. Facts about the columns of ARRI, RED,
Sony, Canon and Blackmagic: the readers and samples of camdkit (SMPTE RIS OSVP),
https://github.com/SMPTE/ris-osvp-metadata-camdkit. `slates` is apart: it reads camera
reports, which describe photographs for `lensfit inspect --slates`.
"""
