# `make demo` and `make test` do all the set-up themselves: Python 3.11+, pip and a C compiler are enough.
# PYTHON=python3.12 chooses the interpreter; NDF_TORCH=index takes the package index's build of torch on Linux.

PYTHON ?= python3
BIN := .venv/bin

.PHONY: help setup demo test lint docs clean

help:
	@echo "make demo    fit, extract and draw something worth looking at (demo/output)"
	@echo "make test    everything that CI runs: style, types, import contracts, tests"
	@echo "make lint    all of that but the tests"
	@echo "make docs    the documentation, as a site (site/index.html)"
	@echo "make setup   only make .venv"
	@echo "make clean   remove .venv and build products"

setup:
	@$(PYTHON) tools/bootstrap.py

demo: setup
	$(BIN)/python examples/demo.py

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

test: lint
	$(BIN)/pytest -n 2

docs: setup
	$(BIN)/python tools/docs_reference.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

clean:
	rm -rf .venv build dist *.egg-info plugins/*/build plugins/*/*.egg-info ndf_core/kernels/*.so
	rm -rf site .pytest_cache .ruff_cache .hypothesis .import_linter_cache demo/output
