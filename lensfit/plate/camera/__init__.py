"""What is known of a plate's camera and its knobs, and which source counts."""
