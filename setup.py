"""Builds the compiled kernels. Everything else is in pyproject.toml."""

import sys
from pathlib import Path

from setuptools import Extension, setup

SOURCES = Path("ndf_core/kernels/src")
FLAGS = ["/O2"] if sys.platform == "win32" else ["-O3", "-fno-math-errno", "-std=c11"]

setup(
    ext_modules=[
        Extension(
            f"ndf_core.kernels._{source.stem}",
            [str(source)],
            depends=[str(header) for header in SOURCES.glob("*.h")],
            extra_compile_args=FLAGS,
            libraries=[] if sys.platform == "win32" else ["m"],
            define_macros=[("Py_LIMITED_API", "0x030B0000")],
            py_limited_api=True,
        )
        for source in sorted(SOURCES.glob("*.c"))
    ],
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
