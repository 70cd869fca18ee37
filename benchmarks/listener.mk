# The listener from nothing: training data, a training for each seed, test sets, figures. `make listener` runs it.
#
#   make listener LISTENER=data/listener GPUS=4 JOBS=16
#
# Every step leaves a file below LISTENER and is left out where it is there already: a run that was stopped goes on. Seconds
# of each step are in LISTENER/times.txt. What does not wait for another step runs at the same time, JOBS of them.
AVS3D ?= .venv/bin/avs3d
PYTHON ?= .venv/bin/python
LISTENER ?= data/listener
# nproc says 1 where OMP_NUM_THREADS=1 is set.
WORKERS ?= $(shell env -u OMP_NUM_THREADS nproc 2>/dev/null || echo 2)
# Of the generator: cpu or cuda.
DEVICE ?= cpu
# How many the trainings and the rows share; 0: they run on the CPU.
GPUS ?= 1
SEEDS ?= 0 1 2
TRAIN ?= scenes_manifest/train.yaml
# A folder with a folder of weights for each seed, seedN: they are calibrated and scored, and nothing is trained.
TRAINED ?=
# The training data has a folder for each of these parts: homes by the last digit of their number, with options of their own.
# `recorded` plays the recordings for training that are in the store; without a GPU, `pathtraced` has the usual pictures.
TRAIN_PARTS ?= $(if $(TRAINED),,tracer pathtraced analytic recorded)
TRAIN_tracer ?= --only '*/home_*[2-7]/*' --audio tracer
TRAIN_analytic ?= --only '*/home_*[08]/*' --audio analytic
TRAIN_recorded ?= --only '*/home_*9/*' --audio tracer
TRAIN_pathtraced ?= --only '*/home_*1/*' --audio tracer $(if $(filter 0,$(GPUS)),,--vision pathtraced)
# Of the workers (%), for what is made at the same time.
SHARE_tracer ?= 52
SHARE_analytic ?= 16
SHARE_recorded ?= 10
SHARE_pathtraced ?= 8
SHARE_tune ?= 14
SHARE_test ?= 50
# SHARE_rows_NAME is that of one test set.
SHARE_rows ?= 12
SHARE_best ?= 36
# PIN_NAME are cores of a part of the training data, of tune or of test (all test sets), as taskset has them (0-23): each program
# begins as many threads as it has cores. Without it a program has all cores.

# Of `avs3d generate` for all parts.
TRAIN_OPTIONS ?= --size 504 --frames 12 $(DRY:%=--with rirs)
# After this time a part of the training data is what has been made of it; without a number it is made whole.
DATA_MINUTES ?=
# Homes and voices for validation, by which thresholds and temperatures are chosen, and other options of `generate` for it.
TUNE ?= scenes_manifest/listen-tune.yaml scenes_manifest/marks-tune.yaml
TUNE_OPTIONS ?= --size 504 --frames 12
# Of each training voice, with whose sounds frames of the training data are dubbed; 0: they are not.
DRY_UNITS ?= 40
# Of each training; the first of them learn what is seen, without sound.
STEPS ?= 4500
PICTURE_STEPS ?= 1500
TRAIN_LISTENER_OPTIONS ?= --validate-every 1600
# Trained weights that each training begins with, $* in the name being its seed; without a file: random ones.
WEIGHTS ?=
# Of the ablation with small networks, which shares the GPUs with the trainings; 0: none.
ABLATION_MINUTES ?= $(if $(TRAINED)$(filter 0,$(GPUS)),0,13)
ABLATION_OPTIONS ?=
# Test sets: NAME is scenes_manifest/NAME.yaml with the tracer's sound, NAME+ENGINE with another engine's, NAME-heads with heads
# for tests, NAME-pathtraced with path-traced pictures. MANIFEST_NAME is another file, TEST_OPTIONS_NAME are more options. Those
# that play recordings or show models of others need these in the store; `all` are those of the docs. Path-traced
# pictures cost the most: they, and the usual pictures that they are compared with, have fewer frames.
TESTS ?= open-s34-o7 listen open-s34-o7-heads open-s34-o7+soundspaces
ifeq ($(TESTS),all)
override TESTS := open-s34-o7 open-s34-o7-recorded open-s34-o7-heads open-s34-o7+soundspaces open-s34-o7-sh3d open-scans \
  open-s34-o7-24frames open-s34-o7-pathtraced listen listen-recorded
endif
TEST_OPTIONS ?= --size 504 --frames 64
MANIFEST_open-s34-o7-24frames ?= scenes_manifest/open-s34-o7.yaml
TEST_OPTIONS_open-s34-o7-24frames ?= --frames 24
TEST_OPTIONS_open-s34-o7-pathtraced ?= --frames 24
TEST_DEVICE ?= $(DEVICE)
# Rows that each seed has, and those of the best seed alone.
ROWS ?= 2d direction both
BEST_TESTS ?= $(TESTS)
BEST_ROWS ?= truth listener controls
# EchoSegnet on the masks of each seed, on these sets; Gaussians, which do not depend on masks, are trained once.
TESTS_3D ?= $(filter open-s34-o7 open-s34-o7-recorded open-s34-o7-sh3d listen,$(TESTS))
OPTIONS_3D ?= --rows spatial --rows spatial-direction --iterations 3000
# Figures of the seeds and of the best one, and its page.
FIGURES ?= $(LISTENER)/figures

SHARDS := $(LISTENER)/train
CARDS := $(SEEDS:%=$(LISTENER)/run/seed%/listener.safetensors)
SCORED := $(foreach test,$(TESTS),$(SEEDS:%=$(LISTENER)/rows-%-$(test).done))
BEST = $$($(PYTHON) -m benchmarks.listener_best $(patsubst %/listener.safetensors,%,$(CARDS)))
DRY = $(if $(filter-out 0,$(DRY_UNITS)),$(LISTENER)/dry.npz)
share = $(shell echo $$(( ($(WORKERS) * $1 + 99) / 100 )))
# $(call on,N): one GPU in turn, if there is any.
on = $(if $(filter 0,$(GPUS)),,CUDA_VISIBLE_DEVICES=$$(( $1 % $(GPUS) )))
# $(call pinned,name)
pinned = $(if $(PIN_$1),taskset -c $(PIN_$1))
# $(call timed,name,command): run it, log it, write down its seconds.
timed = @mkdir -p $(LISTENER)/logs; echo "$1: log in $(LISTENER)/logs/$1.txt"; began=$$(date +%s); \
  { $2; } > $(LISTENER)/logs/$1.txt 2>&1 || { tail -n 3 $(LISTENER)/logs/$1.txt; echo "$1: failed"; exit 1; }; \
  echo "$1 $$(( $$(date +%s) - began )) s" | tee -a $(LISTENER)/times.txt
# $(call tables,seed,sets,options,share of the workers)
tables = $(PYTHON) -m benchmarks.listener_tables $(foreach test,$2,$(test)=$(LISTENER)/tests/$(test)) -o $(LISTENER)/scores/seed$1 \
  --work $(LISTENER)/work/seed$1 --weights $(LISTENER)/run/seed$1/listener.safetensors --workers $(call share,$4) $3

.PHONY: all
all: $(LISTENER)/figures.done

# Each kernel is compiled once, not by every process at once.
$(LISTENER)/kernels.done:
	$(call timed,kernels,$(if $(filter cuda,$(DEVICE)),$(PYTHON) -m tests.support.compile_kernels --device cuda & )$(PYTHON) -m tests.support.compile_kernels$(if $(filter cuda,$(DEVICE)), && wait $$!))
	@touch $@

$(LISTENER)/manifests/train-recorded.yaml:
	$(call timed,recordings,$(PYTHON) -m benchmarks.recorded_manifests --train $(@D))

# Status 1: a few sampled observations found no place; 124: the time was over.
$(LISTENER)/train-%.done: | $(LISTENER)/kernels.done $(LISTENER)/manifests/train-recorded.yaml
	$(call timed,train-$*,$(if $(DATA_MINUTES),timeout -k 20 $(DATA_MINUTES)m) $(call pinned,$*) $(AVS3D) generate \
	  $(if $(filter recorded,$*),$(LISTENER)/manifests/train-recorded.yaml,$(TRAIN)) -o $(SHARDS)/$* --format webdataset \
	  --device $(DEVICE) --workers $(call share,$(SHARE_$*)) $(TRAIN_$*) $(TRAIN_OPTIONS) || { status=$$?; \
	  [ $$status -eq 1 -o $$status -eq 124 ] && ls $(SHARDS)/$*/*.tar > /dev/null; })
	@touch $@

$(LISTENER)/tune.done: | $(LISTENER)/kernels.done
	$(call timed,tune,$(foreach each,$(TUNE),$(call pinned,tune) $(AVS3D) generate $(each) -o $(LISTENER)/tune/$(basename $(notdir $(each))) \
	  --format webdataset --audio tracer --device $(DEVICE) --workers $(call share,$(SHARE_tune)) $(TUNE_OPTIONS) &&) true)
	@touch $@

# Once for all trainings and calibrations.
$(LISTENER)/decoded.done: $(TRAIN_PARTS:%=$(LISTENER)/train-%.done) $(LISTENER)/tune.done
	$(call timed,decoded,$(PYTHON) -m benchmarks.listener_ablation decode $(LISTENER) $(if $(TRAIN_PARTS),train) tune --workers $(WORKERS))
	@touch $@

$(LISTENER)/dry.npz: | $(LISTENER)/kernels.done
	$(call timed,dry,$(PYTHON) -m benchmarks.listener_dry -o $@ --units $(DRY_UNITS) --workers $(WORKERS))

ifdef TRAINED
$(CARDS): $(LISTENER)/run/seed%/listener.safetensors: $(LISTENER)/decoded.done
	$(call timed,seed$*,$(call on,$*) $(PYTHON) -m benchmarks.listener_calibration $(TRAINED)/seed$*/listener.safetensors \
	  --calibrate-on $(LISTENER)/tune --cache $(LISTENER)/tune-cache -o $(@D) --accelerator $(if $(filter 0,$(GPUS)),cpu,cuda))
else
$(CARDS): $(LISTENER)/run/seed%/listener.safetensors: $(LISTENER)/decoded.done $(DRY)
	@mkdir -p $(@D) && ln -sfn $(abspath $(LISTENER)/tune-cache) $(@D)/calibration
	$(call timed,seed$*,$(call on,$*) $(AVS3D) train listener --data $(SHARDS) --cache $(LISTENER)/train-cache \
	  --calibrate-on $(LISTENER)/tune -o $(@D) --seed $* --picture-steps $(PICTURE_STEPS) --steps $(STEPS) --manifest $(TRAIN) $(if $(WEIGHTS),--weights $(WEIGHTS)) \
	  $(DRY:%=--dry %) $(if $(filter 0,$(GPUS)),--accelerator cpu) $(TRAIN_LISTENER_OPTIONS) && [ -f $@ ])
endif

$(LISTENER)/ablation.done: $(LISTENER)/decoded.done
	$(if $(filter-out 0,$(ABLATION_MINUTES)),$(call timed,ablation,$(call on,$(words $(SEEDS))) $(PYTHON) -m benchmarks.listener_ablation train \
	  $(SHARDS) $(LISTENER)/train-cache -o $(LISTENER)/ablation --test 'other homes and voices=$(LISTENER)/tune-cache' --minutes $(ABLATION_MINUTES) $(ABLATION_OPTIONS)))
	@touch $@

# After the training data: both use all cores. Trainings go first. Path tracing takes a GPU, which the training data leaves idle.
$(filter-out %-pathtraced.done,$(TESTS:%=$(LISTENER)/test-%.done)): | $(LISTENER)/decoded.done
$(LISTENER)/test-%.done: | $(LISTENER)/kernels.done
	$(call timed,test-$*,nice -n 10 $(call pinned,test) $(AVS3D) generate \
	  $(or $(MANIFEST_$*),scenes_manifest/$(patsubst %-pathtraced,%,$(patsubst %-heads,%,$(firstword $(subst +, ,$*)))).yaml) \
	  -o $(LISTENER)/tests/$* --audio $(or $(word 2,$(subst +, ,$*)),tracer) --device $(TEST_DEVICE) $(if $(filter %-heads,$*),--hrtf family-test) \
	  $(if $(filter %-pathtraced,$*),--vision pathtraced --workers $(call share,$(SHARE_pathtraced)),--workers $(call share,$(SHARE_test))) \
	  $(TEST_OPTIONS) $(TEST_OPTIONS_$*))
	@touch $@

define rows
$(LISTENER)/rows-$1-$2.done: $(LISTENER)/run/seed$1/listener.safetensors $(LISTENER)/test-$2.done
	$$(call timed,rows-$1-$2,$$(call on,$1) $$(call tables,$1,$2,$$(ROWS:%=--rows %),$$(or $$(SHARE_rows_$2),$$(SHARE_rows))) && $$(call on,$1) $(PYTHON) -m benchmarks.listener_classes \
	  $(LISTENER)/tests/$2 -o $(LISTENER)/scores/seed$1/classes-$2.json --weights $$<)
	@touch $$@
endef
$(foreach seed,$(SEEDS),$(foreach test,$(TESTS),$(eval $(call rows,$(seed),$(test)))))

# The best seed by its calibration, in which no test set takes part; its controls, and EchoSegnet on its masks.
$(LISTENER)/best-rows.done: $(foreach test,$(BEST_TESTS),$(SEEDS:%=$(LISTENER)/rows-%-$(test).done))
	$(if $(BEST_TESTS),$(call timed,best-rows,best=$(BEST) && $(call tables,$$best,$(BEST_TESTS),$(BEST_ROWS:%=--rows %),$(SHARE_best))))
	@touch $@

define rows_3d
$(LISTENER)/rows-3d-$1.done: $(LISTENER)/run/seed$1/listener.safetensors $(TESTS_3D:%=$(LISTENER)/test-%.done)
	$$(if $(TESTS_3D),$$(call timed,rows-3d-$1,mkdir -p $(LISTENER)/work/stages $(LISTENER)/work/seed$1 && ln -sfn ../stages $(LISTENER)/work/seed$1/stages && \
	  $$(call tables,$1,$(TESTS_3D),$(OPTIONS_3D),$(SHARE_best))))
	@touch $$@
endef
$(foreach seed,$(SEEDS),$(eval $(call rows_3d,$(seed))))

$(LISTENER)/figures.done: $(SCORED) $(LISTENER)/best-rows.done $(SEEDS:%=$(LISTENER)/rows-3d-%.done) $(LISTENER)/ablation.done
	@$(MAKE) --no-print-directory -f $(firstword $(MAKEFILE_LIST)) figures
	@touch $@

# What is there so far.
.PHONY: figures
figures:
	$(call timed,figures,mkdir -p $(FIGURES) && best=$(BEST) && \
	  $(PYTHON) -m benchmarks.listener_seeds $(SEEDS:%=$(LISTENER)/scores/seed%) -o $(FIGURES)/listener-seeds.json --table && \
	  $(PYTHON) -m benchmarks.listener_seeds $(LISTENER)/scores/seed$$best -o $(FIGURES)/listener-seeds-package.json && \
	  if [ -d $(LISTENER)/ablation ]; then $(PYTHON) -m benchmarks.listener_ablation collect $(LISTENER)/ablation -o $(FIGURES)/listener-ablation.json; fi && \
	  printf '# The listener\n\n<!-- tables -->\n<!-- end of tables -->\n' > $(FIGURES)/page.md && \
	  $(PYTHON) -m benchmarks.listener_page $(LISTENER)/scores/seed$$best $(foreach test,$(BEST_TESTS),$(test)=$(LISTENER)/tests/$(test)) \
	    --work $(LISTENER)/work/seed$$best --page $(FIGURES)/page.md)
