"""`lensfit synth` and `lensfit bench`: photographs of known truth, and measured bars.

They are doors like those of `lensfit.cli`, which finds them here where `data_synth` is
installed: a lens is measured and put on plates without them.
"""
