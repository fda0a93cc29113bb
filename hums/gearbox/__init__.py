"""The declared mechanism: its kinematics, exact orders, torques and forces."""
