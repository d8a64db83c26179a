"""The command line: one file per command, each a thin door.

Commands of `preset` and `kit` are in a room each, by what they handle.
"""
