"""A preset handed to other programs, and their lenses as presets."""
