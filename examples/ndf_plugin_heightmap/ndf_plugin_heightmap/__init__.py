"""Representation `heightmap` for ndf."""
