# `make help` lists the targets; `make setup` builds ./.venv with everything for the rest.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# LATEST=1 installs the newest versions that pyproject.toml allows, in place of the tested set (docs/install.md).
LATEST ?=
STAMP := $(VENV)/.installed$(if $(LATEST),-latest)
DEMO_STAMP := $(VENV)/.demo$(if $(LATEST),-latest)
# The tested set: with hashes for every extra, and without hashes.
TESTED := constraints.txt
TESTED_VERSIONS := avs3d_bench/runtime/tested_versions.txt
EXTRAS := generate,baselines,train,cluster,inspect,exports,get,sofa,dev,docs
MANIFEST ?= scenes_manifest/open-s34-o7.yaml
NAME := $(basename $(notdir $(MANIFEST)))
OUT ?= data/$(NAME)
# nproc says 1 where OMP_NUM_THREADS=1 is set.
WORKERS ?= $(shell env -u OMP_NUM_THREADS nproc 2>/dev/null || echo 2)
# Processes that share the tests, each of which takes up to 3 GiB. One more than cores, since some tests wait for others.
JOBS ?= $(shell n=$(WORKERS); [ "$$n" -gt 7 ] && echo 8 || echo "$$((n + 1))")
PYTEST = $(BIN)/python -m pytest -n $(JOBS) --dist worksteal --durations 40
# A pinned PyTorch; on a machine with a GPU, `make setup TORCH=torch` installs the newest build.
TORCH ?= torch==2.13.0
# What pip installs for the listener of `make demo`, if the package has its weights: PyTorch for the CPU. Empty: nothing.
TORCH_CPU ?= --index-url https://download.pytorch.org/whl/cpu $(TORCH)
# What PyTorch for the CPU needs; installed before it, since its index does not have every version.
TORCH_NEEDS := safetensors filelock fsspec jinja2 networkx setuptools sympy typing-extensions
LISTENER_WEIGHTS := baselines/listener/weights/listener.safetensors
# The acoustic engine; empty: the manifest's, else the tracer. Without the SoundSpaces engine (it could not be compiled),
# the tracer makes the sound of all manifests.
AUDIO ?= $(shell $(BIN)/python -c 'import rlr_audio_propagation' 2>/dev/null || echo tracer)
WITH_AUDIO = $(if $(AUDIO),--audio $(AUDIO))

# Other options of `avs3d generate`, as in make dataset AUDIO=tracer OPTIONS='--with ambisonics'.
OPTIONS ?=
# The renderer; habitat needs AVS3D_HABITAT_PYTHON, scans need AVS3D_SCANS (`avs3d doctor` checks them).
VISION ?=
# What draws the pictures, bakes the light and, with AUDIO=tracer, traces the sound: cpu or cuda (docs/gpu.md).
DEVICE ?= cpu

.PHONY: help setup demo demo-validate demo-sheets demo-listener dataset release-demo listener test test-slow test-all test-latest lock lint docs bench schemas docs-tables clean

help: ## print one line for each target
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

setup: $(STAMP) ## build ./.venv with everything for the rest, in the tested versions; LATEST=1: in the newest ones

PIP_INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check
PIP = @$(PIP_INSTALL)
# The files of the tested set are for these; elsewhere the same versions are taken, with the files of the platform.
HAS_HASHES = $(BIN)/python -c 'import platform, sys; sys.exit((sys.platform, platform.machine(), platform.python_implementation(), platform.libc_ver()[0]) != ("linux", "x86_64", "CPython", "glibc"))'

define make_venv
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit((v < (3, 11) or (v >= (3, 14) and not "$(LATEST)")) and f"Python 3.11, 3.12 or 3.13 is needed, this is {v.major}.{v.minor}: make PYTHON=python3.12 (for a newer Python than that, untested: make LATEST=1)")'
	$(PYTHON) -m venv $(VENV)
	@rm -f $(VENV)/.installed* $(VENV)/.demo*
endef
# $(call install,EXTRAS,FILES OF HASHED REQUIREMENTS): this project and what it needs.
ifdef LATEST
install = $(PIP_INSTALL) --upgrade --upgrade-strategy eager $(if $(findstring baselines,$(1)),'$(TORCH)') -e '.[$(1)]'
PINNED :=
else
install = if $(HAS_HASHES); then \
    $(PIP_INSTALL) --no-deps --require-hashes $(addprefix -r ,$(2)) && $(PIP_INSTALL) --no-deps --no-build-isolation -e .; \
  else $(PIP_INSTALL) --constraint $(TESTED_VERSIONS) -e '.[$(1)]'; fi
PINNED := --constraint $(TESTED_VERSIONS)
endif
# Compiled with what is installed, so that the build needs no other versions.
define install_engine
	@echo "installing the SoundSpaces engine (a C++ compiler makes it) …"
	@{ $(PIP_INSTALL) $(PINNED) setuptools wheel==0.48.0 pybind11==3.1.0 && \
	   $(PIP_INSTALL) --no-build-isolation --no-deps rlr-audio-propagation==0.0.1; } || \
	  echo "The SoundSpaces engine did not compile (a C++ compiler is needed): make uses --audio tracer instead."
endef

$(STAMP): pyproject.toml $(TESTED)
	$(make_venv)
	@echo "installing PyTorch …"
	$(PIP) $(PINNED) '$(TORCH)'
	@echo "installing the rest …"
	@$(call install,$(EXTRAS),$(TESTED))
	$(install_engine)
	@touch $@ $(DEMO_STAMP)

define install_torch_cpu
	@$(LISTENER_RUNS) || { echo "installing PyTorch for the CPU …" && $(PIP_INSTALL) $(PINNED) $(TORCH_NEEDS) && \
	  $(PIP_INSTALL) --no-deps --retries 1 --timeout 20 $(TORCH_CPU); } || \
	  echo "PyTorch for the CPU could not be installed: the demo goes on without the listener."
endef
LISTENER_RUNS = $(BIN)/python -c 'import torch, safetensors' 2>/dev/null

# Only the packages that the demo needs; `make setup` adds the rest.
$(DEMO_STAMP): pyproject.toml $(TESTED) $(wildcard $(LISTENER_WEIGHTS))
	$(make_venv)
	@echo "installing the generator …"
	@$(call install,generate,docker/build.txt docker/generator.txt)
	$(if $(TORCH_CPU),$(if $(wildcard $(LISTENER_WEIGHTS)),$(install_torch_cpu)))
	@touch $@

lock: setup ## resolve the tested set of versions again and print what changed; LOCK_OPTIONS='--upgrade-package NAME'
	$(PIP) uv
	$(BIN)/python docker/lock.py $(LOCK_OPTIONS)
LOCK_OPTIONS ?= --upgrade

# The submissions of the demo: `avs3d baseline` with these arguments.
BASELINE_centre-box := centre-box
BASELINE_oracle := oracle
BASELINE_oracle-sounding := oracle --instance sounding --points
BASELINE_oracle-with-errors := oracle --instance sounding --drop 0.1 --swap 0.5 --dilate 4 --confuse 0.5 --seed 1
DEMO_SCORES := $(patsubst BASELINE_%,demo-score-%,$(filter BASELINE_%,$(.VARIABLES)))
# Only where it can run: `demo-listener`.
BASELINE_listener := listener --device cpu --looks one

demo: $(DEMO_STAMP) ## generate a small dataset, score four submissions and the listener, write reports
	@echo "generating data/demo …"
	$(BIN)/avs3d generate scenes_manifest/demo.yaml -o data/demo --workers $(WORKERS) $(WITH_AUDIO)
	@mkdir -p data/demo-scores
	@echo "validating, drawing contact sheets, writing and scoring submissions, $(WORKERS) at a time …"
	@$(MAKE) --no-print-directory --output-sync -j $(WORKERS) demo-validate demo-sheets demo-listener $(DEMO_SCORES)
	$(BIN)/avs3d leaderboard data/demo-scores/*.json -o data/demo-leaderboard
	@echo
	@echo "Sheets: data/demo-sheets/*.png. Scores: data/demo-scores/oracle.html, data/demo-leaderboard/index.html."
	@echo "To see and hear the observations in a browser (stop with Ctrl-C):"
	@echo "  $(CURDIR)/$(BIN)/avs3d view $(CURDIR)/data/demo --submission $(CURDIR)/data/demo-submissions/oracle-with-errors"

demo-validate:
	$(BIN)/avs3d validate data/demo --deep --workers 1
demo-sheets:
	$(BIN)/avs3d contact-sheet data/demo -o data/demo-sheets
# The network needs PyTorch and the weights of the package.
demo-listener:
	@why=; [ -f $(LISTENER_WEIGHTS) ] || why="$(LISTENER_WEIGHTS) is not there"; \
	[ -n "$$why" ] || $(LISTENER_RUNS) || why="PyTorch is not installed (make setup installs it)"; \
	if [ -n "$$why" ]; then \
	  echo "The listener is not scored: $$why."; rm -f data/demo-scores/listener.json data/demo-scores/listener.html; \
	else $(MAKE) --no-print-directory -f $(firstword $(MAKEFILE_LIST)) demo-score-listener; fi
$(DEMO_SCORES) demo-score-listener: demo-score-%:
	$(BIN)/avs3d baseline $(BASELINE_$*) --dataset data/demo -o data/demo-submissions/$* --overwrite
	$(BIN)/avs3d-eval data/demo-submissions/$* --dataset data/demo --workers 1 \
	  --json data/demo-scores/$*.json --html data/demo-scores/$*.html

# Every kind of observation at a size that is quickly downloaded: below 60 MB.
release-demo: $(DEMO_STAMP) ## generate a small dataset of six observations and release it into data/release-demo
	$(BIN)/avs3d generate scenes_manifest/demo.yaml -o data/demo-small --size 252 --frames 12 --workers $(WORKERS) $(WITH_AUDIO)
	$(BIN)/avs3d validate data/demo-small --deep --workers $(WORKERS)
	$(BIN)/avs3d release data/demo-small -o data/release-demo --workers $(WORKERS)

dataset: setup ## generate and validate the benchmark: MANIFEST=… OUT=… WORKERS=… VISION=… AUDIO=… DEVICE=… OPTIONS=…
	$(if $(filter cuda,$(DEVICE)),$(PIP) $(PINNED) -e '.[cuda]')
	$(BIN)/avs3d generate $(MANIFEST) -o $(OUT) $(WITH_AUDIO) --device $(DEVICE) \
	  $(if $(filter cpu,$(DEVICE)),--workers $(WORKERS)) $(if $(VISION),--vision $(VISION)) $(OPTIONS)
	$(BIN)/avs3d validate $(OUT) --deep

listener: setup ## make the training data, train the listener with three seeds, make the test sets and the tables: GPUS=… JOBS=… (docs/listener-training.md)
	$(if $(filter cuda,$(DEVICE)),$(PIP) $(PINNED) -e '.[cuda]')
	@$(MAKE) --no-print-directory -f benchmarks/listener.mk -j $(JOBS) AVS3D=$(BIN)/avs3d PYTHON=$(BIN)/python WORKERS=$(WORKERS) DEVICE=$(DEVICE)

# Each module is compiled once, not by each of the hundreds of programs that tests start, whatever the shell says.
test test-slow test-all: export PYTHONDONTWRITEBYTECODE =
# And each kernel of numba, not by every process at once.
KERNELS = -@$(BIN)/python -m tests.support.compile_kernels

test: setup ## run the fast tests, before each commit
	$(KERNELS)
	$(PYTEST) -m "not slow"

test-slow: setup ## run the slow tests: engines, browser, cluster, faults, full-size data
	$(KERNELS)
	$(PYTEST) -m slow

test-latest: ## run the fast tests against the newest versions of all packages, in ./.venv-latest
	$(MAKE) --no-print-directory test VENV=.venv-latest LATEST=1

test-all: setup ## run all tests
	$(KERNELS)
	$(PYTEST)

lint: setup ## check style, types and the documentation site
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(MAKE) docs

# The site of docs/ into site/; a broken link or an unknown name is an error. Nothing is fetched.
docs: setup ## build the documentation site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

docs-tables: setup ## write the tables of recorded figures in README.md and docs/ again
	$(BIN)/python -m benchmarks.docs_tables

bench: setup ## measure speed and memory; writes build/bench.json
	$(BIN)/python -m benchmarks.run

schemas: setup ## write the JSON Schemas in avs3d_bench/contract/schemas again
	$(BIN)/avs3d schema -o avs3d_bench/contract/schemas

clean: ## remove ./.venv, builds and caches
	rm -rf $(VENV) .venv-latest build site *.egg-info .pytest_cache .mypy_cache .ruff_cache
