"""Compare the statements of a shoot with its photographs."""
