# `make demo` and `make test` need Rust (https://rustup.rs), Python 3.10 or later, and nothing else.

PYTHON ?= python3
DEMO := .venv
WORK := .venv-test
PROFILE := dev-fast
# Everything is built with these features, so that it is built once.
FEATURES := test-shaders
# Dependency groups to test with besides: docs, torch.
EXTRAS ?=

# Dependency groups came with pip 25.1.
PIP := -m pip --disable-pip-version-check
NEW_PIP := 'pip>=25.1'

SOURCES := Cargo.toml Cargo.lock pyproject.toml $(shell find src python \
	-name __pycache__ -prune -o -type f ! -name '*.so' ! -name '*.pyd' -print)

# The Rust tests are programs that hold Python, so they need its library: for the linker, and when they run.
# `--tests` leaves out examples in documentation comments. There are none, and cargo would compile the whole crate
# once more, optimised, only to look for them.
LIBPYTHON = $(shell $(WORK)/bin/python -c 'import sysconfig as s, pathlib as p; \
	v = s.get_config_var; d = p.Path(v("LIBDIR") or "."); \
	found = (d / (v("LDLIBRARY") or "-")).is_file() or v("PYTHONFRAMEWORK"); print(d if found else "")')
CARGO = PYO3_PYTHON="$(CURDIR)/$(WORK)/bin/python" cargo

.PHONY: help demo docs gallery lenses passes pictures test properties soak fuzz deny bench clean

help:
	@echo 'make demo     install into $(DEMO) and render the picture that comes with dofsim into dofsim-demo/'
	@echo 'make gallery  draw that picture with every method into build/gallery/'
	@echo 'make lenses   draw that picture through fifteen lenses into build/lenses/'
	@echo 'make passes   draw all that a compositor gets of one scene into build/passes/'
	@echo 'make pictures draw the pictures of the documentation anew, in docs/'
	@echo "make test     check everything, in $(WORK); with EXTRAS='docs torch' documentation and PyTorch, too"
	@echo 'make docs     build the documentation into build/docs/html/'
	@echo 'make properties  try the laws with CASES=2000 inputs each'
	@echo 'make soak     render 2000 pictures and more, from many threads, and see what is left of them; kill 20 batches'
	@echo 'make fuzz     try any bytes as files and as renders, SECONDS=60 each, in part under AddressSanitizer'
	@echo 'make deny     check licences, sources and known faults of what dofsim is built from'
	@echo 'make bench    speed and memory, as tables and in build/bench.json'
	@echo 'make clean    remove what these made, but not the ray traced scenes in build/'

demo: $(DEMO)/.installed
	$(DEMO)/bin/dofsim demo -o dofsim-demo

gallery: $(DEMO)/.installed
	$(DEMO)/bin/python docs/gallery.py build/gallery

lenses: $(DEMO)/.installed
	$(DEMO)/bin/python docs/lenses.py build/lenses

passes: $(DEMO)/.installed
	$(DEMO)/bin/python docs/passes.py build/passes

pictures: $(WORK)/.installed
	$(WORK)/bin/python docs/pictures.py

$(DEMO)/.installed: $(SOURCES)
	$(PYTHON) -m venv $(DEMO)
	$(DEMO)/bin/python $(PIP) install --quiet --upgrade $(NEW_PIP)
	$(DEMO)/bin/python $(PIP) install '.[metrics]'
	@touch $@

# The tools change with pyproject.toml, the compiled part with every source.
$(WORK)/.tools: pyproject.toml
	$(PYTHON) -m venv $(WORK)
	$(WORK)/bin/python $(PIP) install --quiet --upgrade $(NEW_PIP)
	$(WORK)/bin/python $(PIP) install --quiet --group test --group lint
	@for group in reference prescription $(EXTRAS); do $(WORK)/bin/python $(PIP) install --quiet --group $$group \
		|| echo "SKIPPED: $$group cannot be installed here; its tests will be skipped"; done
	@touch $@

$(WORK)/.installed: $(WORK)/.tools $(SOURCES)
	$(WORK)/bin/python $(PIP) install --quiet --editable . --config-settings 'build-args=--profile $(PROFILE) --features $(FEATURES)'
	@touch $@

test: $(WORK)/.installed
	cargo fmt --check
	RUSTDOCFLAGS='-D warnings' $(CARGO) doc --quiet --no-deps --document-private-items --profile $(PROFILE) \
		--features $(FEATURES)
	$(CARGO) clippy --quiet --all-targets --profile $(PROFILE) --features $(FEATURES) -- -D warnings
ifeq ($(shell uname -s),Darwin)
	$(if $(LIBPYTHON),DYLD_LIBRARY_PATH="$(LIBPYTHON)" $(CARGO) test --tests --profile $(PROFILE) --features $(FEATURES),$(NO_LIBPYTHON))
else
	$(if $(LIBPYTHON),LD_LIBRARY_PATH="$(LIBPYTHON)" $(CARGO) test --tests --profile $(PROFILE) --features $(FEATURES),$(NO_LIBPYTHON))
endif
	$(WORK)/bin/ruff check
	$(WORK)/bin/ruff format --check
	$(WORK)/bin/mypy
	$(WORK)/bin/python -m mypy.stubtest dofsim._dofsim
	$(WORK)/bin/python -m pytest -ra

docs: $(WORK)/.installed
	$(WORK)/bin/python $(PIP) install --quiet --group docs
	$(WORK)/bin/python -m sphinx -W --keep-going -b html -d build/docs/trees docs build/docs/html

NO_LIBPYTHON = @echo 'SKIPPED: cargo test: this Python has no library to link with (Debian: python3-dev)'

# How many cases each law is tried with.
CASES ?= 2000

properties: $(WORK)/.installed
	DOFSIM_CASES=$(CASES) $(WORK)/bin/python -m pytest -q tests/properties

# How many renders leave nothing behind; how often batches are killed, and how many are run in pairs.
RENDERS ?= 2000
KILLS ?= 20
PAIRS ?= 5

soak: $(WORK)/.installed
	DOFSIM_RENDERS=$(RENDERS) $(WORK)/bin/python -m pytest -q -s tests/test_load.py -k 'threads or left'
	DOFSIM_KILLS=$(KILLS) DOFSIM_PAIRS=$(PAIRS) $(WORK)/bin/python -m pytest -q -s tests/test_batch_killed.py

# How long each target is fuzzed; what is found goes to build/fuzz/ and tests/fuzz/artifacts/. Needs
# `cargo install cargo-fuzz` and a nightly Rust; without that: RUSTC_BOOTSTRAP=1 make fuzz FUZZ='cargo fuzz'
SECONDS ?= 60
FUZZ ?= cargo +nightly fuzz
FUZZED := raster jpeg profile exr render
# What is parsed in Python, and by libraries of others.
PARSED := npy npz deep hdf5 dpt mitsuba blender toml csv jsonl heic phone

fuzz: $(WORK)/.installed
	mkdir -p $(FUZZED:%=build/fuzz/%)
	for kind in $(PARSED); do \
		$(WORK)/bin/python tests/fuzz/parsers.py $$kind build/fuzz/$$kind --seconds $(SECONDS) || exit 1; \
	done
	$(FUZZ) build --fuzz-dir tests/fuzz -O --target-dir target/fuzz
	for target in $(FUZZED); do \
		$(FUZZ) run --fuzz-dir tests/fuzz -O --target-dir target/fuzz $$target build/fuzz/$$target \
			tests/fuzz/seeds/$$target -- -max_total_time=$(SECONDS) -rss_limit_mb=3000 -timeout=25 \
			-max_len=4096 -len_control=0 || exit 1; \
	done

# Needs `cargo install cargo-deny`; where the database of advisories cannot be had: CHECKS="bans licenses sources".
CHECKS ?= advisories bans licenses sources

deny:
	cargo deny check $(CHECKS)

bench: $(DEMO)/.installed
	$(DEMO)/bin/python $(PIP) install --quiet --group bench
	$(DEMO)/bin/python $(PIP) install --quiet --group reference
	$(DEMO)/bin/python tests/bench/suite.py

clean:
	rm -rf $(DEMO) $(WORK) target dist dofsim-demo .mypy_cache .pytest_cache .ruff_cache
	find python tests \( -name __pycache__ -o -name '_dofsim*.so' -o -name '_dofsim*.pyd' \) -prune \
		-exec rm -rf {} +
