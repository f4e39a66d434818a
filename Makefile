# make demo: a robot hands a wrench to a moving person; make test: the whole suite.
# Python 3.11 is taken where it runs: pybullet, which draws, has wheels for it only.
PYTHON ?= $(shell for p in python3.11 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	&& { echo $$p; break; }; done)
VENV := .venv
BIN := $(VENV)/bin
# the folder is this one, whatever a package of its name would mean: no warning of it
PIP := PYTHONWARNINGS="ignore:Editable installation" $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check

.PHONY: demo test lint docs clean

demo: $(VENV)/.sim
	$(BIN)/odm demo handover

# keeps byte code: where none is kept, each of the tests' commands would make it again
test: export PYTHONDONTWRITEBYTECODE =
test: $(VENV)/.test
	$(BIN)/odm warmup
	@# two processes whose BLAS has a thread for each core wait for each other, spinning
	@# a process that ends early fails its test; pytest-xdist may wait for a new one forever
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --max-worker-restart 0

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html
	@echo docs/_build/html/index.html

clean:
	rm -rf out docs/_build build dist *.egg-info maps/built .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed"; exit 1; }
	@$(PYTHON) -c 'import sys; v = sys.version_info; print("Python %d.%d" % v[:2]); \
	v < (3, 12) or print("pybullet has no wheels for it: the demo moves a plain arm and draws it itself; with Python 3.11 it would be the Panda")'
	$(PYTHON) -m venv $(VENV)
	@# a pip of today takes half the time; without it the one that is there will do
	@$(PIP) --upgrade pip || true

$(VENV)/.sim: pyproject.toml | $(BIN)/python
	@echo "installing into $(VENV) ..."
	@$(PIP) -e '.[sim]'
	@touch $@

$(VENV)/.test: pyproject.toml | $(BIN)/python
	@echo "installing into $(VENV), tests included ..."
	@$(PIP) -e '.[test]'
	@touch $@

$(VENV)/.docs: pyproject.toml | $(BIN)/python
	@echo "installing into $(VENV), with what builds the docs ..."
	@$(PIP) -e '.[docs]'
	@touch $@

$(VENV)/.dev: pyproject.toml | $(BIN)/python
	@$(PIP) -e '.[dev]'
	@touch $@
