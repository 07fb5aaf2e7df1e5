# `make demo`, `make notebooks` and `make test` set everything up themselves, in .venv, and start at
# once the second time.
# Arguments pass through: make demo ARGS="--headless", make test ARGS="-k ik".

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=

.PHONY: demo notebooks test check clean

demo: $(VENV)/.demo
	$(BIN)/python -m baxter_kin.demo $(ARGS)

notebooks: $(VENV)/.notebook
	$(BIN)/python -m jupyterlab --notebook-dir notebooks $(ARGS)

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto $(ARGS)

check: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

clean:
	rm -rf $(VENV) build dist *.egg-info

# Debian's Python lacks ensurepip unless python3-venv is installed; then the outer pip fetches one.
$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo "baxter-kin needs Python 3.10 or later; call: make PYTHON=python3.X"; exit 1; }
	$(PYTHON) -m venv $(VENV) >/dev/null || { rm -rf $(VENV) \
	  && $(PYTHON) -m venv --without-pip $(VENV) \
	  && $(PYTHON) -m pip --python $@ install --quiet pip; }

$(VENV)/.demo: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/.notebook: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[notebook]'
	touch $@ $(VENV)/.demo

$(VENV)/.dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@ $(VENV)/.demo
