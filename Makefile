# Each target works alone on a clean checkout; all of them build the virtual environment first.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python .ci/install.py $(BIN)/python --editable
# Only files that name the browser: to collect all others takes a quarter of a minute.
PAGES = -m "browser and not slow" $$(grep -rlw browser tests --include='test_*.py')
# Workers are forks of one process that has collected all (tests/forks.py).
PYTEST = $(BIN)/python -m pytest -p tests.forks
# Without kept bytecode each process compiles all that it imports: three CPU seconds for SciPy and numba.
unexport PYTHONDONTWRITEBYTECODE
.PHONY: serve demo test pytest pytest-all kernels ci-environment test-slow test-browser lint bench bench-vasculature bench-tissue bench-link bench-solids bench-registration bench-embedded bench-flow bench-paper bench-search bench-operator bench-firmware bench-observe docs gallery dist test-dist audit clean

demo: $(VENV)/.ready
	$(BIN)/printctl run examples/planar_fresh.yaml

# The operator's page at http://127.0.0.1:8080, in the folder workspace/; ARGS="--port 9000" for more.
serve: $(VENV)/.ready-web
	$(BIN)/printctl serve $(ARGS)

test: lint pytest

pytest: kernels
	$(PYTEST) --forks 3

# The same and pages in Chromium, at once: what CI runs.
pytest-all: kernels
	$(PYTEST) -m "not slow" --forks 4

# All kernels, compiled by all cores before tests want them; no work where they are kept.
kernels: $(VENV)/.ready-test
	$(BIN)/printctl doctor --warm

# Long runs of shipped examples, minutes each; more sizes, seeds, themes and examples of what CI tests.
test-slow: kernels
	PRINTCTL_NIGHTLY=1 $(PYTEST) -m "slow or hypothesis" --forks 2

# Pages in Chromium, and the API against its description; skipped where there is no Chromium.
# A file that fails beside another browser on the same two cores is tried once more, alone.
test-browser: kernels
	$(PYTEST) $(PAGES) --forks 2

lint: $(VENV)/.ready-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.pipeline

# Minutes; with svv beside it where it installs. BENCH="--large" adds a million terminals.
bench-vasculature: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.vasculature $(BENCH)

# Minutes: how exact and fast tissues answer, and a battery of them.
bench-tissue: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.tissue

# Minutes: every promise of the printer link, on the simulated printer; BENCH="--quick" for one or two.
bench-link: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.link $(BENCH)

# Minutes, most of them PrusaSlicer's where it is installed; BENCH="--quick" without the large part.
bench-solids: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.solids $(BENCH)

# Scan to report; BENCH="--quick" for a tenth of the cases. Then scans of two generators that share no code
# with us, hours in full: SCANS="--count 4 --keep DIR" for fewer. BENCH="--only ..." leaves these out.
bench-registration: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.registration $(BENCH)
	@$(if $(findstring --only,$(BENCH)),:,$(BIN)/python -m benchmarks.scan_bench $(if $(findstring --quick,$(BENCH)),--quick) $(SCANS))

# Vessels written into soft matter, judged by a checker of its own; BENCH="--quick" without the 2,000.
bench-embedded: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.embedded $(BENCH)

# Lumped flow, steady and pulsatile; BENCH="--quick" without the million vessels.
bench-flow: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.flow $(BENCH)

# The paper's cases (docs/paper.md): ten minutes, where nilearn is installed 24; BENCH=--quick two.
# The figures as measured here are drawn into build/paper_panels.png.
bench-paper: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.paper $(BENCH)

# A design search in one process and on two workers; BENCH="--quick" for eight candidates.
bench-search: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.search $(BENCH)

# Real firmware, built elsewhere, in simulated boards, judged by step edges; each path may be left out.
# MARLIN=ep.elf MARLIN_WITHOUT_PARSER=noep.elf MARLIN_FAST=250k.elf KLIPPER=folder BENCH="--quick"
bench-firmware: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.firmware_bench $(if $(MARLIN),--marlin $(MARLIN)) \
	  $(if $(MARLIN_WITHOUT_PARSER),--marlin-without-parser $(MARLIN_WITHOUT_PARSER)) \
	  $(if $(MARLIN_FAST),--marlin-fast $(MARLIN_FAST)) $(if $(KLIPPER),--klipper $(KLIPPER)) $(BENCH)

# Observed prints: what is seen, frames, mends, whole prints, kills; half an hour.
bench-observe: $(VENV)/.ready-test
	@for name in seeing bath camera frames mends prints faults; do $(BIN)/python -m benchmarks.observe_$$name; done

# The user guide, in site/: opens without a network. Fails on a dead link, as CI does.
docs: $(VENV)/.ready-docs
	$(BIN)/python -m docs_tools.commands
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

# Minutes: runs the examples and draws the guide's gallery anew; NAMES="ring_closed_loop" for some.
gallery: $(VENV)/.ready-test
	$(BIN)/python -m docs_tools.gallery $(NAMES)

# Wheel and source distribution, in dist/.
dist: $(VENV)/.ready-release
	$(BIN)/python .ci/dist.py build

# The same, and the wheel tried in an environment that has nothing else.
test-dist: $(VENV)/.ready-release
	$(BIN)/python .ci/dist.py try

# Known vulnerabilities of what constraints.txt pins; says so where no service answers.
audit: $(VENV)/.ready-release
	$(BIN)/python .ci/audit.py

# The page while it prints: the stop's way to the wire, what browsers cost, how soon a picture is seen;
# and the way from a clone to a first print. BENCH="--quick" for few tries.
bench-operator: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks.operator $(BENCH)
	@$(BIN)/python -m benchmarks.operator_view $(BENCH)
	@$(BIN)/python -m benchmarks.operator_stop_door $(BENCH)
	@$(BIN)/python -m benchmarks.operator_kills $(BENCH)
	@$(BIN)/python -m benchmarks.operator_first_print

$(VENV)/.ready-pip: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "printctl needs Python 3.11 or newer; this is " + sys.version)'
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.ready: $(VENV)/.ready-pip
	$(INSTALL) .
	touch $@

# Kernels are compiled when they are first needed: the page is seen sooner.
$(VENV)/.ready-web: $(VENV)/.ready-pip
	$(INSTALL) ".[web]"
	touch $@

$(VENV)/.ready-test: $(VENV)/.ready
	$(INSTALL) ".[test]"
	touch $@

$(VENV)/.ready-docs: $(VENV)/.ready
	$(INSTALL) ".[docs]"
	touch $@

$(VENV)/.ready-release: $(VENV)/.ready
	$(INSTALL) ".[release]"
	touch $@

# What tests, guide and release need, at once and by uv where there is one.
ci-environment: $(VENV)/.ready-pip
	$(INSTALL) ".[test,docs,release]"
	touch $(VENV)/.ready
	touch $(VENV)/.ready-test $(VENV)/.ready-docs $(VENV)/.ready-release

clean:
	rm -rf $(VENV) build dist site *.egg-info .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
