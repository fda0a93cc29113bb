"""Scenes: what one declares, each table checked."""
