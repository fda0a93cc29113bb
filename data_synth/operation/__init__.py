"""Speed, torque, the exact angle of a shaft, and the events of its tachometer."""
