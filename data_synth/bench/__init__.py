"""What lensfit is measured by: its benchmarks, and what every one of them shares."""
