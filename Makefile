# Every target sets up what it needs itself, in .venv, and starts at once the second time; how, and
# what it does about libraries and browsers of the system, stands in scripts/set_up.py.
# Arguments pass through: make demo ARGS="--headless", make test ARGS="-k ik".

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=

.PHONY: demo notebooks test check clean

demo: $(VENV)/.demo
	$(BIN)/python -m baxter_kin.demo $(ARGS)

notebooks: $(VENV)/.notebooks
	$(BIN)/python -m jupyterlab --notebook-dir notebooks $(ARGS)

test: $(VENV)/.test
	$(BIN)/python -m pytest -n auto $(ARGS)

check: $(VENV)/.check
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

clean:
	rm -rf $(VENV) build dist *.egg-info

SET_UP := $(addprefix $(VENV)/.,demo notebooks check test)

$(SET_UP): $(VENV)/.%: pyproject.toml scripts/set_up.py
	@$(PYTHON) scripts/set_up.py $* --venv $(VENV)
	@touch $@ $(VENV)/.demo
