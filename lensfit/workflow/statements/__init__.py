"""What was stated of a shoot, held against what its photographs show."""
