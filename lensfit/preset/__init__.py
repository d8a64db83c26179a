"""The lens as a JSON file: schema, upgrades, selection by focal length and focus."""
