# make demo       installs z2p into .venv and renders the sample scans into previews/
# make test       installs the pipeline too and runs every check; make test-fast leaves out Blender and whole pipelines
# make soak       kills a whole small pipeline fifty times at random moments; every result must have the same bytes
# make fuzz       tries odd inputs and settings for SECONDS=60, of SEED=0, on TARGETS="readers configs" or on all
# PYTHON=...      chooses another Python 3.11; pip takes its options from its usual variables and files

VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= $(shell command -v python3.11 || command -v python3)
LIGHT := $(VENV)/light.stamp
FULL := $(VENV)/full.stamp
PROJECT := pyproject.toml constraints.txt $(wildcard z2p_core/native/*.[ch]) z2p_core/native/compiling.py scripts/compiler.sh
PIP_INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
PYTEST = OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile

.PHONY: demo test test-fast soak fuzz lint clean

demo: $(LIGHT)
	$(BIN)/z2p render samples --output previews --overwrite
	@echo "the pictures are in previews/; one of a scan of your own: $(BIN)/z2p render SCAN.ply --output SCAN.png"

test: $(FULL)
	$(PYTEST)
	$(MAKE) lint

test-fast: $(FULL)
	$(PYTEST) -m "not slow"

soak: $(FULL)
	OMP_NUM_THREADS=1 $(BIN)/python tests/workflows/soak.py 50

SECONDS ?= 60
SEED ?= 0
fuzz: $(FULL)
	OMP_NUM_THREADS=1 $(BIN)/python tests/fuzz/run.py $(TARGETS) --seconds $(SECONDS) --seed $(SEED)

lint: $(FULL)
	$(BIN)/ruff check
	$(BIN)/mypy

clean:
	rm -rf $(VENV) previews build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "z2p needs Python 3.11, and there is no python3 here; install it" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { \
		echo "z2p needs Python 3.11, got $$($(PYTHON) --version); name one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(LIGHT): $(PROJECT) | $(BIN)/python
	sh scripts/compiler.sh
	@echo "installing z2p into $(VENV); the first time takes a few minutes"
	$(PIP_INSTALL) --editable .
	@touch $@

$(FULL): $(PROJECT) scripts/system_libraries.sh | $(BIN)/python
	sh scripts/compiler.sh
	sh scripts/system_libraries.sh
	@echo "installing z2p and its pipeline into $(VENV); the first time takes several minutes"
	$(PIP_INSTALL) --editable ".[pipeline,test]"
	@touch $(LIGHT) $@
