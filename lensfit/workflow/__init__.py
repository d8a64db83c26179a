"""The whole jobs that notebooks and the command line call."""
