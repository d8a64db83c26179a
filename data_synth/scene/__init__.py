"""CG scenes of plane layers, and their photographs by exact ray tracing.

Scene coordinates: origin at the centre of the lens' paraxial entrance pupil, x right,
y down, and depth along the axis away from the camera, all in mm. A ray is where it
crosses the entrance-pupil plane and its slopes dx/ddepth, dy/ddepth.
"""
