VENV ?= .venv
PHOTOS ?= ../shared/data/3_backgrounds
SETS ?= ../shared/data/2_sfm
EXAMPLES ?= 3000
BIN := $(VENV)/bin
PINNED := PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt
INSTALL := $(PINNED) $(BIN)/python -m pip install --quiet --disable-pip-version-check

.PHONY: help demo test site robust fuzz audit sbom hashes licences ros bench peers train lint picture clean

help:
	@echo "make demo    run the bundled sample, then open out/demo/report.html"
	@echo "make test    lint, types, layers, tests, and the wheel in an empty environment"
	@echo "make site    the documentation as pages: build/site/index.html"
	@echo "make robust  the tests that depend on rounding: kernels of other processors, threads, load"
	@echo "make fuzz    the tests of damaged files with EXAMPLES=3000 of each kind: hours"
	@echo "make audit   known weaknesses of the pinned packages, asked of PyPI"
	@echo "make sbom    what an installation brings, with licences: build/sbom.cdx.json (CycloneDX)"
	@echo "make hashes  the same by hash, for this machine: build/hashes.txt (pip --require-hashes)"
	@echo "make licences  the list of licences in the docs: docs/figures/licences.csv"
	@echo "make ros     the ROS 2 node against real rclpy, Kilted and Jazzy"
	@echo "make bench   the slow tests and the benchmarks: hours"
	@echo "make peers   what peers and bounds were measured, again: fails where a ratio is worse"
	@echo "make train   train the shipped networks again: hours; photos in PHOTOS=DIR, sets in SETS=DIR"
	@echo "make lint    ruff, mypy, import-linter and the limits on names only"
	@echo "make picture draw the packages and their imports: docs/images/packages.svg"

demo: $(VENV)/runtime.stamp
	$(BIN)/locate demo -o out/demo

test: lint
	$(BIN)/python -m pytest -m "not slow" -n 2 --dist loadfile
	tests/wheel_check.sh $(BIN)/python

site: $(VENV)/dev.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

robust: $(VENV)/dev.stamp
	$(BIN)/python .ci/robustness

fuzz: $(VENV)/dev.stamp
	LOCATE_FUZZ_EXAMPLES=$(EXAMPLES) $(BIN)/python -m pytest tests/fuzz -n 2 --maxfail 1000

audit: build/tools.stamp
	build/tools/bin/pip-audit --requirement constraints.txt --no-deps

sbom: $(VENV)/runtime.stamp build/tools.stamp
	build/tools/bin/cyclonedx-py environment --output-reproducible --pyproject pyproject.toml \
		--output-file build/sbom.cdx.json $(BIN)/python

hashes: build/installed.json
	$(BIN)/python .ci/installed.py hashes $< >build/hashes.txt

licences: build/installed.json $(VENV)/runtime.stamp
	$(BIN)/python .ci/installed.py licences $< >docs/figures/licences.csv

build/installed.json: pyproject.toml constraints.txt | $(BIN)/python
	@mkdir -p build
	$(INSTALL) --dry-run --ignore-installed --report $@ .

build/tools.stamp:
	.ci/venv build/tools
	build/tools/bin/python -m pip install --quiet cyclonedx-bom pip-audit
	@touch $@

ros:
	.ci/ros/run

bench: $(VENV)/dev.stamp
	$(BIN)/python -m pytest -m slow
	$(MAKE) fuzz
	$(BIN)/python -m benchmarks.cost run
	$(BIN)/python -m benchmarks.planner straight
	$(BIN)/python -m benchmarks.planner turbulent
	$(BIN)/python -m benchmarks.fusion geometry
	$(BIN)/python -m benchmarks.scenes orbit
	$(BIN)/python -m benchmarks.reliability film
	$(BIN)/python -m benchmarks.reliability score
	$(BIN)/python -m benchmarks.reliability report
	$(BIN)/python -m benchmarks.real_frames film
	$(BIN)/python -m benchmarks.real_frames run
	$(BIN)/python -m benchmarks.real_frames table
	$(BIN)/python -m benchmarks.sfm
	$(BIN)/python -m benchmarks.telemetry_offset
	$(BIN)/python -m benchmarks.flow simulated
	$(BIN)/python -m benchmarks.flow pairs
	$(BIN)/python -m benchmarks.paper deflected
	$(BIN)/python -m benchmarks.paper moving
	$(BIN)/python -m benchmarks.survey fusion
	$(BIN)/python -m benchmarks.survey joining
	$(BIN)/python -m benchmarks.robot offline
	$(BIN)/python -m benchmarks.robot update
	$(MAKE) peers

peers: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.peers displacement --pairs 1 --out build/peers
	$(BIN)/python -m benchmarks.peers network --out build/peers
	$(BIN)/python -m benchmarks.peers location --draws 5 --out build/peers
	$(BIN)/python -m benchmarks.peers poses --sets sample --rounds 1 --out build/peers
	$(BIN)/python -m benchmarks.bounds displacement --pairs 3 --out build/peers
	$(BIN)/python -m benchmarks.bounds source --draws 4 --out build/peers
	$(BIN)/python -m benchmarks.bounds weak-plume --out build/peers
	$(BIN)/python -m benchmarks.peers compare build/peers

train: $(VENV)/dev.stamp
	mkdir -p build/data/sets
	ln -sfn $(abspath $(PHOTOS)) build/data/photos
	ln -sfn $(abspath $(SETS))/lund_door build/data/sets/lund_door
	$(BIN)/locate run $(SETS)/drone_caliterra_gps/images_half -o build/data/sets/caliterra
	$(BIN)/locate run $(SETS)/drone_brighton_beach_gps/images_half -o build/data/sets/brighton_beach
	$(BIN)/locate train lite-fast -o build/lite_fast --data build/data
	$(BIN)/locate train judge -o build/judge --data build/data
	$(BIN)/locate train registered -o build/registered --data build/data

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python .ci/names.py --most-duplicates 0 --most-loose 0

picture: $(VENV)/dev.stamp
	$(BIN)/python .ci/packages.py -o docs/images/packages.svg

clean:
	rm -rf build dist out

$(BIN)/python:
	.ci/venv $(VENV)

$(VENV)/runtime.stamp: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing; the first time takes a minute or two."
	$(INSTALL) -e .
	@touch $@

$(VENV)/dev.stamp: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing with the tools for development; the first time takes a minute or two."
	$(INSTALL) -e ".[dev]"
	@touch $@ $(VENV)/runtime.stamp
