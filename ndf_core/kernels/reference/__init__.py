"""Readable numpy versions of the kernels, which the tests compare the compiled ones with; slow on purpose."""
