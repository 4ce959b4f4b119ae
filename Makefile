# make demo: the main job on the bundled recording.   make check: what to run before a commit.
# make test: the tests, in minutes.   make test-slow: whole flights, fuzzers, kills.   make test-all: both.
# make coverage: all tests, and which lines they run.   make docs: the pages and the API reference as a site, in site/.
# make bench-all: every benchmark that holds a promise, for hours; make bench-field: one of them. Into bench-results/.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready
# Tests wait much of their time, so there are more processes than cores; each keeps its arithmetic to one core. They start
# others by the dozen, so compiled modules are kept.
TEST_PROCESSES ?= 4
PYTEST = OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= \
	$(BIN)/python -m pytest -q --numprocesses $(TEST_PROCESSES) --dist worksteal $(PYTEST_OPTIONS)
# What docs/reliability.md, docs/identity.md and the README rest on, and what lists wrong names, words and screens.
BENCHES := paper latency field recorded statements screens screens.speed soak video.looking \
	$(addprefix fuzz.,logs datagrams streams readers) \
	$(addprefix receiving.,flood flood_claims tlog_speed)

.PHONY: demo test test-slow test-all coverage check lint types layers docs bench-all lock clean

demo: $(READY)
	@echo "gcs demo: replays a bundled recording; q leaves, ? lists the keys"
	$(BIN)/gcs demo

test: $(READY)
	$(PYTEST) -m "not slow"

test-slow: $(READY)
	$(PYTEST) -m slow

test-all: $(READY)
	$(PYTEST)

# Takes two and a half times the processor of the tests alone.
coverage: $(READY)
	$(MAKE) test-all PYTEST_OPTIONS="--cov"

check: lint types layers test

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

layers: $(READY)
	$(BIN)/lint-imports --no-cache

docs: $(READY)
	$(BIN)/python -m pip install --quiet --require-hashes --requirement requirements-docs.lock
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@! grep -rlE '<(script|link|img)[^>]* (src|href)="?https?:' site --include='*.html' || (echo "these pages fetch from elsewhere"; false)

bench-all: $(addprefix bench-,$(BENCHES))

# bench-fuzz.logs is python -m bench.fuzz logs; the others are modules.
bench-%: $(READY)
	$(BIN)/python -m bench.$(patsubst fuzz.%,fuzz %,$*) $(if $(filter recorded,$*),sitl_logs) $(BENCH_OPTIONS)

# The pinned set, by hash; the project itself on top, in place.
$(READY): requirements.lock pyproject.toml
	@$(PYTHON) .ci/set_up.py $(VENV)
	touch $@

# Needs uv on the path; commit the results.
# Extras stay in the names: in hash mode pip does not see that "coverage[toml]" is pinned where the lock says "coverage".
LOCK := uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
	--no-header --no-annotate --no-strip-extras --upgrade

lock:
	$(LOCK) --extra dev pyproject.toml --output-file requirements.lock
	$(LOCK) --group docs --constraint requirements.lock --output-file requirements-docs.lock

clean:
	rm -rf $(VENV) build site *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
