"""Speed, torque, exact shaft angle, and tachometer events."""
