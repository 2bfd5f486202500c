"""Configuration: `FitConfig`, recipes, and layers of options with provenance. Import from the submodules."""
