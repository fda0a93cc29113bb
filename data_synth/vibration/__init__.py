"""Gears that vibrate: meshes, torques, motion, and the forces at the sensors."""
