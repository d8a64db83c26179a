"""Effects that no chart photograph shows: filters, reflections, glare, white balance.

`stack` has the order of operations; every other file is one effect or one tool.
"""
