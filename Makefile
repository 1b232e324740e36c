# make demo       installs z2p into .venv and renders the sample scans into previews/
# make test       installs the pipeline too and runs every check; make test-fast leaves out what takes seconds, as Blender does
# make soak       kills a whole small pipeline fifty times at random moments; every result must have the same bytes
# make fuzz       tries odd inputs and settings for SECONDS=60, of SEED=0, on TARGETS="readers configs" or on all
# PYTHON=...      chooses a Python from 3.11 on; where .venv was made by another one, a folder such as .venv-3.13 is used
# VENV=...        chooses the folder; pip takes its options from its usual variables and files

SERIES = $(if $(1),$(shell $(1) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null))
MADE_BY := $(call SERIES,.venv/bin/python)
NAMED := $(or $(PYTHON),$(if $(MADE_BY),.venv/bin/python) python3.11 python3.13 python3.12 python3.14 python3)
FOUND := $(shell sh scripts/python.sh $(NAMED))
VENV := .venv$(if $(MADE_BY),$(addprefix -,$(filter-out $(MADE_BY),$(call SERIES,$(FOUND)))))
BIN := $(VENV)/bin
LIGHT := $(VENV)/light.stamp
FULL := $(VENV)/full.stamp
TYPES := build/types/z2p_renderer
PROJECT := pyproject.toml constraints.txt $(wildcard z2p_core/native/c/*/*.[ch]) z2p_core/native/build.py \
           setup.py scripts/compiler.sh
PIP_INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
BLENDER = $(if $(filter 3.13,$(call SERIES,$(BIN)/python)),$(PIP_INSTALL) --no-deps bpy)
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
	OMP_NUM_THREADS=1 PYTHONPATH=tests/workflows $(BIN)/python tests/workflows/faults/soak.py 50

SECONDS ?= 60
SEED ?= 0
fuzz: $(FULL)
	OMP_NUM_THREADS=1 $(BIN)/python tests/fuzz/run.py $(TARGETS) --seconds $(SECONDS) --seed $(SEED)

lint: $(FULL) | $(TYPES)/__init__.py
	$(BIN)/ruff check
	$(BIN)/mypy

# What mypy reads: the folders as parts of z2p_renderer, as setup.py installs them.
$(TYPES)/__init__.py:
	rm -rf $(TYPES)
	mkdir -p $(TYPES)
	cd $(TYPES) && ln -s ../../../z2p_renderer/__init__.py ../../../pipeline ../../../plugins ../../../storage \
		../../../workflows .

clean:
	rm -rf $(VENV) previews build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

ifeq ($(FOUND)$(filter clean,$(MAKECMDGOALS)),)
$(error z2p needs Python 3.11 or later, and of $(NAMED) none is; name one: make PYTHON=/path/to/python3)
endif

$(BIN)/python:
	$(FOUND) -m venv --clear $(VENV) || { rm -rf $(VENV); exit 1; }

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
	$(BLENDER)
	@touch $(LIGHT) $@
