"""Charts to photograph: what they show, how they say what they are, how they lie.

Chart millimetres: x right, y down on the upright sheet, origin at its top left corner.
"""
