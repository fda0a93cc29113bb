"""Gearboxes: kinematics, exact orders, torques and forces of a declared mechanism."""
