"""Representations of ndf that are triangles without order, or points."""
