"""Gear dynamics: meshes, torques, motion, and forces at the sensors."""
