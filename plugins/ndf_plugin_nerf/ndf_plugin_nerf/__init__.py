"""Plugin of ndf: neural radiance fields, as the outer level set of their density."""
