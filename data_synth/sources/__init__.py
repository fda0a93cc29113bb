"""The prepared scene: everything except gears in motion."""
