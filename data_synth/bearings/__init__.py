"""What a damaged bearing does: strikes with slip and load zone, or a model that moves."""
