"""How light falls off over the frame, from how bright the detections are."""
