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
BENCHES = bench-vasculature bench-tissue bench-flow bench-solids bench-embedded bench-link bench-operator \
  bench-observe bench-firmware bench-registration bench-identity bench-scans bench-machines bench-paper bench-evidence
.PHONY: serve demo test pytest pytest-all kernels ci-environment test-slow test-browser lint bench bench-first-parts bench-nightly $(BENCHES) docs gallery looks dist test-dist audit clean

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

# Each measures one subject's promises (docs/benchmarks.md); SUBJECTS in benchmarks/__main__.py names the
# parts. BENCH="--quick" takes at most 60 CPU s, BENCH="--only PART" one part, both together work.
# Other programs come by the environment: MARLIN=, MARLIN_WITHOUT_PARSER=, MARLIN_FAST= (ELF files),
# OPENBF_CHECKOUT=, SHARED_SCANS= (folder of a generator), SCANS= (how many of each),
# PRINTCTL_SHARED_DATA= (meshes), NETWORK_HOSTS= (folder of Moonraker, Klipper and OctoPrint); a part that
# needs what isn't there is skipped by name.
$(BENCHES): bench-%: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks $* $(BENCH)

# Strangers' parts from recipe to verdict, and planted faults, an hour and a half; SEED=, PARTS=, FAULTS=.
bench-first-parts: kernels
	@$(BIN)/python -m tests.system.first_part.run --seed $(or $(SEED),$(shell date +%s)) \
	  --parts $(or $(PARTS),60) --faults $(or $(FAULTS),10) --out runs/first_parts

# Stages of the two example recipes.
bench: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks pipeline $(BENCH)

# The quick forms of all, one after the other, a quarter of an hour; fails and names those that broke.
bench-nightly: $(VENV)/.ready-test
	@$(BIN)/python -m benchmarks nightly

# The user guide, in site/: opens without a network. Fails on a dead link, as CI does.
docs: $(VENV)/.ready-docs
	$(BIN)/python -m docs_tools.commands
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

# The page's pictures anew: those that tests compare it with, and the guide's. Look at what changed.
looks: kernels
	PRINTCTL_LOOKS=write $(PYTEST) -m "browser and not slow" $$(grep -rlw assert_alike tests --include='test_*.py') --forks 2
	$(BIN)/python -m docs_tools.pages

# Minutes: runs the examples and draws the guide's gallery anew; NAMES="ring_closed_loop" for some.
gallery: $(VENV)/.ready-test
	$(BIN)/python -m docs_tools.gallery $(NAMES)

# Wheel and source distribution, in dist/.
dist: $(VENV)/.ready-release
	$(BIN)/python .ci/dist.py build

# The same, and the wheel tried in an environment that has nothing else.
test-dist: $(VENV)/.ready-release
	$(BIN)/python .ci/dist.py try

# Known vulnerabilities of what constraints.txt pins; fails where no service answers (AUDIT=--if-reachable: says so).
audit: $(VENV)/.ready-release
	$(BIN)/python .ci/audit.py $(AUDIT)

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
