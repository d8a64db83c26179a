"""Presets kept by name: numbered versions, levels of a project, recorded edits."""
