# Every target sets up what it needs itself, in .venv, and starts at once the second time; how, and
# what it does about libraries and browsers of the system, stands in scripts/set_up.py.
# Arguments pass through: make demo ARGS="--headless", make test ARGS="-k ik".

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
AS_ROOT = $(if $(filter 0,$(shell id -u)),--allow-root) # JupyterLab refuses root without it
unexport PYTHONDONTWRITEBYTECODE # some images set it; then each process compiles what it imports

.PHONY: demo notebooks docs test test-all quick check clean

demo: $(VENV)/.demo
	$(BIN)/python -m baxter_kin.demo $(ARGS)

notebooks: $(VENV)/.notebooks
	$(BIN)/python -m jupyterlab --notebook-dir notebooks $(AS_ROOT) $(ARGS)

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -n -W --keep-going -b html docs build/docs $(ARGS)
	$(BIN)/python scripts/check_site.py build/docs

test: $(VENV)/.test
	$(BIN)/python -m pytest -n auto $(ARGS)

test-all: $(VENV)/.test # with slow tests, and campaigns, which take hours
	$(BIN)/python -m pytest -n auto -m "" $(ARGS)

quick: check $(VENV)/.test # while you work: what is checked, and the laws, with few examples each
	$(BIN)/python -m pytest -q -n auto -m "hypothesis and not slow and not campaign" \
	  --hypothesis-profile=quick tests/baxter_kin tests/planner $(ARGS)

check: $(VENV)/.check
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

clean:
	rm -rf $(VENV) build dist *.egg-info docs/notebooks docs/stories docs/sg_execution_times.rst

SET_UP := $(addprefix $(VENV)/.,demo notebooks docs check test)

$(SET_UP): $(VENV)/.%: pyproject.toml scripts/set_up.py
	@$(PYTHON) -c "import sys; sys.version_info < (3, 7) and sys.exit('set-up: Python %d.%d is too old; baxter-kin needs 3.10 or later; call: make PYTHON=python3.12' % sys.version_info[:2])"
	@$(PYTHON) scripts/set_up.py $* --venv $(VENV)
	@touch $@ $(VENV)/.demo $(if $(filter test,$*),$(VENV)/.check)
