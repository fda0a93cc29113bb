"""What a damaged bearing does: it strikes, with slip and load zone."""
