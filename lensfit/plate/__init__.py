"""A plate, from its header to the finished frame: camera, layers, frame, farm."""
