"""Plugin of ndf: surfaces that are zero sets of signed distance fields."""
