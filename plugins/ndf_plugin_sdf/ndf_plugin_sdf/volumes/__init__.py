"""Scalar volumes: reading them with their frame, choosing the iso value, keeping what matters."""
