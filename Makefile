# Everything that people and CI run. `make help` lists it.
SHELL := /bin/bash
BIN := .venv/bin
READY := .venv/.set-up
TORCH_READY := .venv-torch/.set-up
# More arguments for a target's command: make demo ARGS="--target couch", make test ARGS="-k fusion -x".
ARGS ?=
# Processes among which `make test` divides the tests.
TEST_WORKERS ?= 2
# Images for `make sbom`.
IMAGES ?= surveilnav surveilnav-simulation

.DEFAULT_GOAL := help
.PHONY: help setup check test coverage docs-site canary test-page test-torch test-compose test-faults soak fuzz lock sbom demo dataset bench bench-core bench-models bench-perception bench-bus bench-traffic bench-gateway bench-render bench-calibration bench-chances bench-live bench-same-actions docs clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-18s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(READY) ## .venv, pinned packages, system libraries, furniture (PYTHON=python3.11 chooses a Python)

$(READY): pyproject.toml constraints.txt tools/setup
	@PYTHON='$(PYTHON)' tools/setup
	@touch $@

check: $(READY) ## format, lint, types, import rules
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: $(READY) ## all tests that need no Docker engine, on real Zenoh; TEST_WORKERS=0 runs them in one process
	$(BIN)/python -m pytest -q -m "not compose and not page and not faults" -n $(TEST_WORKERS) --dist worksteal $(ARGS)

coverage: $(READY) ## `make test`, with the lines that tests run counted, and printed by package (what CI runs)
	@$(MAKE) --no-print-directory test ARGS="--cov --cov-report= $(ARGS)"
	@$(BIN)/python tools/coverage_table.py

canary: $(READY) ## sixteen fixed searches, action by action as written in benchmark/canary.json (2 minutes)
	$(BIN)/python -m surveilnav.benchmark.canary $(ARGS)

test-page: $(READY) ## the page in a browser, on a running system (skipped where there is no Chromium)
	$(BIN)/python -m pytest -q tests/page $(ARGS)

$(TORCH_READY): $(READY) tools/setup-torch
	@tools/setup-torch
	@touch $@

test-torch: $(TORCH_READY) ## tests of the networks under PyTorch, in .venv-torch, on tiny models (minutes)
	.venv-torch/bin/python -m pytest -q tests/torch $(ARGS)

test-compose: $(READY) ## the compose file, on a real Docker engine (skipped where there is none)
	$(BIN)/python -m pytest -q tests/compose $(ARGS)

test-faults: $(READY) ## each kind of fault happens once to a running system (10 minutes); as root also on full disks and cut networks
	$(BIN)/python -m pytest -q tests/faults $(ARGS)

soak: $(READY) ## every kind of fault five times, 200 bring-ups (hours); resumable; prints a table; ARGS="--times 1 --bring-ups 20"
	$(BIN)/python -m tests.faults.soak $(ARGS)

fuzz: $(READY) ## a million inputs for every decoder and file reader (an hour); resumable; ARGS="--inputs 50000 --seed 7"
	$(BIN)/python -m tests.fuzz.decoders --inputs 1000000 --state runs/fuzz/decoders.json $(ARGS)

lock: $(READY) ## what the images install, with hashes, in requirements/; after changes of pyproject.toml or constraints.txt
	$(BIN)/python tools/lock.py

sbom: $(READY) ## what the images that Compose has built contain, as CycloneDX, in build/sbom; IMAGES="surveilnav-gpu"
	$(BIN)/python tools/sbom.py $(IMAGES)

demo: $(READY) ## one search in a simulated home; the report lands in runs/
	$(BIN)/surveilnav demo $(ARGS)

dataset: $(READY) ## the benchmark's buildings, cameras and episodes, in data/; resumable
	$(BIN)/surveilnav dataset build $(ARGS)

bench: $(READY) ## the benchmark's tables: plays what is missing of their runs (hours); make bench ARGS="range density"
	$(BIN)/surveilnav bench table $(ARGS)

bench-core: $(READY) ## what a robot step costs, detector left out
	$(BIN)/python tests/bench/bench_fusion.py $(ARGS)
	$(BIN)/python -m pytest -q tests/bench/bench_fusion.py tests/bench/bench_planner.py --benchmark-timer=time.process_time --benchmark-columns=min,median,max,rounds

bench-models: $(TORCH_READY) ## what full-size networks cost, on random weights; in .venv-torch
	.venv-torch/bin/python -m tests.bench.bench_models $(ARGS)

bench-perception: $(READY) ## what a perception worker serves: throughput, overload, memory, a frozen worker
	$(BIN)/python tests/bench/bench_perception.py $(ARGS)

bench-bus: $(READY) ## what a frozen reader or a slow link does to everybody else, by congestion control (half an hour or more)
	$(BIN)/python tests/bench/bench_bus.py $(ARGS)

bench-traffic: $(READY) ## what a search, the time after it and another search put on the bus, by link and key (3 minutes)
	$(BIN)/python -m pytest -q -s tests/bench/bench_traffic.py

bench-gateway: $(READY) ## what pages and programs cost the gateway, and the search beside them (7 minutes)
	$(BIN)/python tests/bench/bench_gateway.py $(ARGS)

bench-render: $(READY) ## what a view costs, with baked light and without
	$(BIN)/python tests/bench/bench_render.py $(ARGS)

bench-calibration: $(READY) ## the simulated detector fitted to the real one; resumable; needs detector weights
	$(BIN)/python -m surveilnav.benchmark.studies.calibration $(ARGS)

bench-chances: $(READY) ## how likely a detection is right, by score, class, size and range, for one backend; ARGS="--backend compact"
	$(BIN)/python -m surveilnav.benchmark.studies.calibration.chances $(ARGS)

bench-live: $(READY) ## the running system with cameras and without, start by start; resumable; ARGS="--buildings flats_210 office_211"
	$(BIN)/python -m surveilnav.benchmark.studies.live $(ARGS)

bench-same-actions: $(READY) ## what bench-live played, again in one process, action by action; ARGS="runs/live/oracle.jsonl"
	$(BIN)/python -m surveilnav.benchmark.studies.same_actions $(ARGS)

docs: $(READY) ## write what is generated: the contract, the settings, the commands, the card of compact, the README's plot
	$(BIN)/python -m surveilnav.contract > docs/understand/contract.md
	$(BIN)/python -m surveilnav.cli.settings_page docs/use
	$(BIN)/python -m surveilnav.cli.command_page > docs/use/command-line.md
	$(BIN)/python -m training.detector.card > docs/understand/compact.md
	$(BIN)/python -m surveilnav.benchmark.tables.readme docs/images/results.png

docs-site: $(READY) ## the documentation as a site, in site/; fails where a link leads nowhere
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build

clean: ## remove caches; .venv, .venv-torch and runs/ stay
	rm -rf .benchmarks .coverage site .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache build dist
	find . -path './.venv*' -prune -o -name __pycache__ -type d -exec rm -rf {} +
