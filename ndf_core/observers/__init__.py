"""Observers that ndf-core itself offers to ``ndf fit --observe``. They register as a plugin's would."""
