"""Plugin of ndf: trained 3D Gaussian splats."""
