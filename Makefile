# `make help` lists the targets; `make setup` builds ./.venv with everything for the rest.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
MANIFEST ?= scenes_manifest/open-s34-o7.yaml
NAME := $(basename $(notdir $(MANIFEST)))
OUT ?= data/$(NAME)
WORKERS ?= $(shell nproc 2>/dev/null || echo 2)
# A pinned PyTorch: on a machine with a GPU, `make setup TORCH=torch` takes the newest build.
TORCH ?= torch==2.13.0
# Where the SoundSpaces engine could not be compiled, sound comes from the closed-form renderer.
AUDIO ?= $(shell $(BIN)/python -c 'import rlr_audio_propagation' 2>/dev/null && echo soundspaces || echo analytic)

# The renderer; habitat needs AVS3D_HABITAT_PYTHON, scans need AVS3D_SCANS (`avs3d doctor` says what is there).
VISION ?= embree

.PHONY: help setup demo dataset test lint docs bench schemas clean

help: ## print a line for each target
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-9s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

setup: $(STAMP) ## build ./.venv with everything for the rest

$(STAMP): pyproject.toml
	$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(v < (3, 11) and f"Python 3.11 or newer is needed, this is {v.major}.{v.minor}: make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check '$(TORCH)'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[generate,baselines,cluster,inspect,exports,dev,docs]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[soundspaces]' || \
	  echo "The SoundSpaces engine did not compile (a C++ compiler is needed): make uses --audio analytic instead."
	touch $@

demo: setup ## generate two observations, score six submissions, write reports
	@echo "sound by $(AUDIO)"
	$(BIN)/avs3d generate scenes_manifest/demo.yaml -o data/demo --workers $(WORKERS) --audio $(AUDIO)
	$(BIN)/avs3d validate data/demo --deep
	$(BIN)/avs3d contact-sheet data/demo -o data/demo-sheets
	$(BIN)/avs3d baseline all-black --dataset data/demo -o data/demo-submissions/all-black --overwrite
	$(BIN)/avs3d baseline all-white --dataset data/demo -o data/demo-submissions/all-white --overwrite
	$(BIN)/avs3d baseline centre-box --dataset data/demo -o data/demo-submissions/centre-box --overwrite
	$(BIN)/avs3d baseline oracle --dataset data/demo -o data/demo-submissions/oracle --overwrite
	$(BIN)/avs3d baseline oracle --dataset data/demo -o data/demo-submissions/oracle-sounding --overwrite \
	  --instance sounding --points
	$(BIN)/avs3d baseline oracle --dataset data/demo -o data/demo-submissions/oracle-with-errors --overwrite \
	  --instance sounding --drop 0.1 --swap 0.5 --dilate 4 --confuse 0.5 --seed 1
	@mkdir -p data/demo-scores
	for name in all-black all-white centre-box oracle oracle-sounding oracle-with-errors; do \
	  $(BIN)/avs3d-eval data/demo-submissions/$$name --dataset data/demo \
	    --json data/demo-scores/$$name.json --html data/demo-scores/$$name.html || exit 1; \
	done
	$(BIN)/avs3d leaderboard data/demo-scores/*.json -o data/demo-leaderboard
	@echo "Look at data/demo-sheets/*.png, data/demo-scores/oracle.html and data/demo-leaderboard/index.html."

dataset: setup ## generate and validate the benchmark: MANIFEST=… OUT=… WORKERS=… VISION=… AUDIO=…
	@echo "sound by $(AUDIO)"
	$(BIN)/avs3d generate $(MANIFEST) -o $(OUT) --workers $(WORKERS) --audio $(AUDIO) --vision $(VISION)
	$(BIN)/avs3d validate $(OUT) --deep

test: setup ## run all tests
	$(BIN)/python -m pytest

lint: setup ## check style, types and the documentation site
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(MAKE) docs

# The site of docs/ into site/; a broken link or an unknown name is an error. Nothing is fetched.
docs: setup ## build the documentation site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

bench: setup ## measure speed and memory; writes build/bench.json
	$(BIN)/python -m benchmarks.run

schemas: setup ## write the JSON Schemas of the contract again
	$(BIN)/avs3d schema -o avs3d_bench/schemas

clean: ## remove ./.venv, builds and caches
	rm -rf $(VENV) build site *.egg-info .pytest_cache .mypy_cache .ruff_cache
