# The listener from nothing: training data, training, test sets, tables and their page. `make listener` runs it.
#
#   make listener LISTENER=data/listener GPUS=2 MINUTES=10
#
# Every step leaves a file below LISTENER and is left out where it is there already: a run that was stopped goes on. Minutes
# of each step are in LISTENER/times.txt. Test sets are made while the network trains.
AVS3D ?= .venv/bin/avs3d
PYTHON ?= .venv/bin/python
LISTENER ?= data/listener
# nproc says 1 where OMP_NUM_THREADS=1 is set.
WORKERS ?= $(shell env -u OMP_NUM_THREADS nproc 2>/dev/null || echo 2)
# Of the generator: cpu or cuda.
DEVICE ?= cpu
# How many the training uses; 0: it runs on the CPU.
GPUS ?= 1
TRAIN ?= scenes_manifest/train.yaml
# The training data has a folder for each of these parts: homes by the last digit of their number, with options of their own.
# `recorded` plays the recordings for training that are in the store; without a GPU, `pathtraced` has the usual pictures.
TRAIN_PARTS ?= pathtraced tracer analytic recorded
TRAIN_tracer ?= --only '*/home_*[2-7]/*' --audio tracer
TRAIN_analytic ?= --only '*/home_*[08]/*' --audio analytic
TRAIN_recorded ?= --only '*/home_*9/*' --audio tracer
TRAIN_pathtraced ?= --only '*/home_*1/*' --audio tracer $(if $(filter 0,$(GPUS)),,--vision pathtraced --workers 4)
# Of `avs3d generate` for all parts.
TRAIN_OPTIONS ?= --frames 12
# Homes and voices for validation, by which thresholds and temperatures are chosen, and other options of `generate` for it.
TUNE ?= scenes_manifest/listen-tune.yaml scenes_manifest/marks-tune.yaml
TUNE_OPTIONS ?= --size 252 --frames 12
EPOCHS ?= 30
# Of the training, before these: they learn what is seen, without sound.
PICTURE_STEPS ?= 1300
# After this time the training stops; the same command goes on.
MINUTES ?= 20
TRAIN_LISTENER_OPTIONS ?=
# Manifests in scenes_manifest/, made with the tracer's sound; NAME+ENGINE makes one with another engine's.
TESTS ?= open-s34-o7 listen open-s34-o7+soundspaces
TEST_OPTIONS ?=
# Of the Gaussians of EchoSegnet.
ITERATIONS ?= 7000
SCORES ?= docs/results
PAGE ?= docs/listener-results.md
TABLES_OPTIONS ?=

SHARDS := $(LISTENER)/train
RUN := $(LISTENER)/run
WEIGHTS := $(RUN)/listener.safetensors
ROOTS := $(TESTS:%=$(LISTENER)/tests/%)
TABLES := $(PYTHON) -m benchmarks.listener_tables $(ROOTS) -o $(SCORES) --work $(LISTENER)/work --weights $(WEIGHTS) \
  --workers $(WORKERS) $(TABLES_OPTIONS)
# $(call timed,name,command): run it, log it, write down its seconds.
timed = @mkdir -p $(LISTENER)/logs; echo "$1: log in $(LISTENER)/logs/$1.txt"; began=$$(date +%s); \
  { $2; } > $(LISTENER)/logs/$1.txt 2>&1 || { tail -n 3 $(LISTENER)/logs/$1.txt; echo "$1: failed"; exit 1; }; \
  echo "$1 $$(( $$(date +%s) - began )) s" | tee -a $(LISTENER)/times.txt

.PHONY: all
all: $(LISTENER)/page.done

$(LISTENER)/manifests/train-recorded.yaml:
	$(call timed,recordings,$(PYTHON) -m benchmarks.recorded_manifests --train $(@D))

# Status 1 with a list of shards: a few sampled observations found no place.
$(LISTENER)/train-%.done: | $(LISTENER)/manifests/train-recorded.yaml
	$(call timed,train-$*,$(AVS3D) generate $(if $(filter recorded,$*),$(firstword $|),$(TRAIN)) -o $(SHARDS)/$* --format webdataset \
	  --device $(DEVICE) --workers $(WORKERS) $(TRAIN_$*) $(TRAIN_OPTIONS) || { [ $$? -eq 1 ] && [ -f $(SHARDS)/$*/shards.json ]; })
	@touch $@

$(LISTENER)/train-data.done: $(TRAIN_PARTS:%=$(LISTENER)/train-%.done)
	@touch $@

$(LISTENER)/tune-data.done: | $(LISTENER)/train-data.done
	$(call timed,tune-data,$(foreach each,$(TUNE),$(AVS3D) generate $(each) -o $(LISTENER)/tune/$(basename $(notdir $(each))) \
	  --format webdataset --audio tracer --device $(DEVICE) --workers $(WORKERS) $(TUNE_OPTIONS) &&) true)
	@touch $@

$(WEIGHTS): $(LISTENER)/train-data.done $(LISTENER)/tune-data.done
	$(call timed,train,$(PYTHON) -m benchmarks.listener_training --data $(SHARDS) -o $(RUN) --epochs $(EPOCHS) \
	  --picture-steps $(PICTURE_STEPS) --minutes $(MINUTES) --manifest $(TRAIN) --calibrate-on $(LISTENER)/tune $(if $(filter 0,$(GPUS)),--accelerator cpu,--devices $(GPUS)) \
	  $(TRAIN_LISTENER_OPTIONS) && [ -f $@ ])

# After the training data: both use all cores.
$(LISTENER)/test-%.done: | $(LISTENER)/train-data.done
	$(call timed,test-$*,$(AVS3D) generate scenes_manifest/$(firstword $(subst +, ,$*)).yaml -o $(LISTENER)/tests/$* \
	  --audio $(or $(word 2,$(subst +, ,$*)),tracer) --device $(DEVICE) --workers $(WORKERS) $(TEST_OPTIONS))
	@touch $@

$(LISTENER)/2d.done: $(WEIGHTS) $(TESTS:%=$(LISTENER)/test-%.done)
	$(call timed,rows-2d,$(TABLES))
	@touch $@

$(LISTENER)/echosegnet.done: $(LISTENER)/2d.done
	$(call timed,rows-echosegnet,$(TABLES) --rows echosegnet --iterations $(ITERATIONS))
	@touch $@

$(LISTENER)/page.done: $(LISTENER)/echosegnet.done
	$(call timed,page,{ [ -f $(PAGE) ] || cp docs/listener-results.md $(PAGE); } && $(PYTHON) -m benchmarks.listener_page $(SCORES) $(ROOTS) --work $(LISTENER)/work --page $(PAGE))
	@touch $@
