# These commands do all the set-up; each makes and fills .venv itself and is quick the second time.
#   make demo   track the bundled clip
#   make serve  the page: draw a box in the browser
#   make test   run the tests
# make docs builds the documentation into site/.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# The CPU build of torch by version: a bare "torch" may pull gigabytes of CUDA.
TORCH ?= torch==2.13.0
SHARED_DATA ?= ../shared/data
# `make eval` runs the standard comparison and writes docs/benchmarks.md; it takes about an hour.
# More for it: trackers such as EVAL="-t tld", or options such as EVAL="--resume".
EVAL ?=
# The files of NanoTrack and FEAR-XS are not part of the repository.
PEERS := $(if $(wildcard ../shared/peers/nanotrack),-t nanotrack-v2 -t nanotrack-v3) \
    $(if $(wildcard ../shared/peers/fear),-t fear-xs)
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

# `make serve SERVE="--port 9000"` hands options on.
SERVE ?= --open

.PHONY: demo serve test lint docs eval measure speed train clean

demo: $(VENV)/.tracking
	$(BIN)/python examples/demo.py

serve: $(VENV)/.serve
	$(BIN)/re3 serve $(SERVE)

test: $(VENV)/.development
	$(BIN)/python -m pytest

lint: $(VENV)/.development
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(VENV)/.docs
	$(BIN)/python tools/build_docs.py

eval: $(VENV)/.report
	$(BIN)/re3 eval $(SHARED_DATA)/val/davis $(SHARED_DATA)/val/segtrack $(SHARED_DATA)/test/otb \
	    -t re3-base -t re3-lite -t kcf -t kcf-persistent -t csrt -t mosse -t medianflow -t first-box \
	    -t random-walk $(PEERS) $(EVAL) --out out/eval
	cp out/eval/report.md docs/benchmarks.md

# All that docs and model cards say of the shipped weights; after they change. EVAL="--jobs 2" halves
# the time, but for speed, which is measured with one sequence at a time. Pages docs/benchmarks*-added.md
# have trackers that were measured later than the others; they are not needed any more after this.
measure: eval $(VENV)/.development
	$(BIN)/re3 eval $(SHARED_DATA)/val/davis $(SHARED_DATA)/val/segtrack -t re3-base -t re3-lite \
	    -t re3-lite@no-search $(PEERS) -t csrt -t kcf --protocol hidden $(EVAL) --out out/hidden
	cp out/hidden/report.md docs/benchmarks-hidden.md
	$(BIN)/re3 eval $(SHARED_DATA)/train/single/tld -t re3-base -t re3-lite -t re3-lite@no-search \
	    $(PEERS) -t csrt -t kcf $(EVAL) --out out/absent
	cp out/absent/report.md docs/benchmarks-absent.md
	$(BIN)/re3 eval $(SHARED_DATA)/val/davis -s scooter-black,car-shadow,drift-chicane,dog -t re3-base \
	    -t re3-lite -t kcf -t kcf-persistent -t csrt -t mosse -t medianflow $(PEERS) --out out/speed
	cp out/speed/report.md docs/benchmarks-speed.md
	$(BIN)/python tools/cards.py
	$(BIN)/python tools/tables.py
	$(BIN)/python tools/figures.py

# Every measurement of speed, into docs/speed-figures.md; one alone: SPEED="--only limits".
speed: $(VENV)/.development
	$(BIN)/python benchmarks/figures.py $(SPEED)

train: $(VENV)/.development
	nice $(BIN)/re3 train --model re3-lite --data $(SHARED_DATA)/train --out runs/re3-lite

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else f"re3 needs Python 3.11 or newer, {sys.executable} is {v.major}.{v.minor}; set PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.tracking: pyproject.toml | $(VENV)/bin/python
	@echo "installing what tracking needs into $(VENV) ..."
	@$(PIP) install --editable .
	@touch $@

$(VENV)/.serve: pyproject.toml | $(BIN)/python
	@echo "installing what tracking and the page need into $(VENV) ..."
	@$(PIP) install --editable '.[serve]'
	@touch $@ $(VENV)/.tracking

$(VENV)/.report: pyproject.toml | $(BIN)/python
	@echo "installing what tracking and reports need into $(VENV) ..."
	@$(PIP) install --editable '.[report]'
	@touch $@ $(VENV)/.tracking

$(VENV)/.docs: pyproject.toml | $(BIN)/python
	@echo "installing what the documentation needs into $(VENV) ..."
	@$(PIP) install --editable '.[docs]'
	@touch $@ $(VENV)/.tracking

$(VENV)/.development: pyproject.toml | $(VENV)/bin/python
	@echo "installing what tests and training need into $(VENV) ..."
	@$(PIP) install '$(TORCH)'
	@$(PIP) install --editable '.[train,dev,docs,report,serve,vot,openvino]'
	@$(PIP) install --no-deps vot-toolkit==0.9.0  # by itself it would bring a second OpenCV
	@touch $@ $(VENV)/.tracking $(VENV)/.report $(VENV)/.docs $(VENV)/.serve

clean:
	rm -rf $(VENV) out site build dist .cache .pytest_cache .mypy_cache .ruff_cache
