"""The scene, prepared: everything but moving gears."""
