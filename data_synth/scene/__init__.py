"""What a scene declares, each table checked."""
