# `make demo` and `make test` include all set-up; `make help` lists the other targets.

PREFIX ?= /usr/local
SCENES ?= livingroom kitchen office park sponza garden orchard valley
# Scene and options of `make demo`; with these defaults the measurement takes about a minute and a half on one core.
DEMO_SCENE ?= orchard
DEMO_OPTIONS ?= --points 8000 --reference-rays 512

FUZZ_SECONDS ?= 3600
# How often `make kills` ends a batch; `make test` does so six times.
KILLS ?= 50

TARGET_DIR := $(or $(CARGO_TARGET_DIR),target)
BINARY := $(TARGET_DIR)/release/mrvis
# Folder with libmrvis.so and libmrvis.a.
LIBRARIES = $(dir $(BINARY))
# Of the Debian package.
MAINTAINER ?= The mrvis authors <mrvis@example.invalid>
RUST_VERSION := 1.89
# Where cargo keeps the sources of other crates: messages of panics in what is installed name files without it. Set here alone, so that
# builds by `cargo` itself are as ever; the two kinds of builds do not replace each other's crates.
CRATES := $(or $(CARGO_HOME),$(HOME)/.cargo)/registry/src

# rustup adds its folder to the PATH of login shells only.
export PATH := $(PATH):$(HOME)/.cargo/bin
SHELL := /bin/bash

.PHONY: help demo test test-room test-long setup-tests build scenes install install-files dist python python-test sky-reference fuzz kills batch-speed clean distclean
.PHONY: setup need-cargo need-packages need-embree need-furniture need-lint need-browser need-install need-hosts need-python need-libclang need-mpi
.DEFAULT_GOAL := help

help:
	@echo "mrvis: visibility and radiosity in scenes full of small detail"
	@echo
	@echo "  make demo      set up, build, assemble an orchard, measure it, print the path of the report"
	@echo "  make test      set up, then check formatting, lints and documentation and run the short tests"
	@echo "  make test-room test one folder of src or command/src after a change, as make test-room ROOM=radiosity"
	@echo "  make test-long make test, and what takes hours: checkers of memory, fuzzing, large scenes, the whole reproduction"
	@echo "  make build     set up and build the command ($(BINARY)) and the C library beside it"
	@echo "  make scenes    assemble the scenes in scenes/real (a selection: make scenes SCENES=\"park sponza\")"
	@echo "  make python    build the Python package as a wheel in $(TARGET_DIR)/wheels"
	@echo "  make install   install the command and the C library under PREFIX (now $(PREFIX))"
	@echo "  make dist      make a .tar.gz and a Debian package of both in out/dist"
	@echo "  make fuzz      search for files that readers fail at, FUZZ_SECONDS (now $(FUZZ_SECONDS)) in all"
	@echo "  make kills     end batches of jobs at KILLS (now $(KILLS)) random moments: nothing may be lost"
	@echo "  make batch-speed  compare a batch with solves in one process"
	@echo "  make clean     remove build products and reports; distclean: also assembled scenes and the private Embree"
	@echo
	@echo "Embree 4 is taken from EMBREE_DIR if that is set, else from the system, else downloaded into .prefix."

# --- set-up: each step prints what it does; a step that is done already is skipped ------------------------------------

setup: need-cargo need-packages need-embree

need-cargo:
	@command -v cargo >/dev/null 2>&1 || { \
	  echo "mrvis: cargo is missing: install Rust $(RUST_VERSION) or later with rustup, then run make again" >&2; \
	  echo "mrvis: (Debian 13 and later: apt-get install rustup, then rustup default stable)" >&2; exit 1; }
	@have=$$(cargo --version | cut -d' ' -f2); \
	  [ "$$(printf '%s\n' $(RUST_VERSION) "$$have" | sort -V | head -n 1)" = $(RUST_VERSION) ] || { \
	  echo "mrvis: cargo is $$have, Rust $(RUST_VERSION) or later is required: run rustup update stable" >&2; exit 1; }

need-packages:
	@.ci/debian-packages g++=g++ gcc=cc binutils=strip python3=python3

need-embree: need-packages
	@.ci/get-embree

need-furniture: need-packages
	@[ -d /usr/share/sweethome3d/furniture ] || .ci/debian-packages sweethome3d-furniture

need-browser:
	@command -v chromium-browser >/dev/null 2>&1 || command -v google-chrome >/dev/null 2>&1 || \
	  .ci/debian-packages chromium=chromium fonts-liberation

# pyenv and others bring venv along; Debian packs it apart.
need-python: need-packages
	@python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "mrvis: $$(python3 --version) is too old for the Python package: 3.11 or later is required" >&2; exit 1; }
	@python3 -c 'import ensurepip' 2>/dev/null || .ci/debian-packages python3-venv

need-install:
	@.ci/debian-packages patchelf=patchelf

# What the tests of the C library use: build systems and compilers of its hosts, TBB of one of them, a checker of memory.
need-hosts: need-install
	@.ci/debian-packages cmake=cmake pkg-config=pkg-config clang=clang valgrind=valgrind dpkg-dev=dpkg-shlibdeps libtbb-dev

# What bindgen loads, which reads the C header for its test and the headers of MPI. What is installed is built without.
need-libclang: need-packages
	@$(if $(LIBCLANG_PATH),:,.ci/debian-packages libclang-dev)

# What the feature `mpi` needs: the headers and the launcher of Open MPI. Only its tests, as the default build has no MPI.
need-mpi: need-libclang
	@.ci/debian-packages openmpi-bin=mpirun libopenmpi-dev=mpicc

need-lint: need-cargo
	@for part in fmt clippy; do \
	  cargo $$part --version >/dev/null 2>&1 && continue; \
	  name=$${part/fmt/rustfmt}; echo "mrvis: installing the Rust component $$name" >&2; \
	  rustup component add $$name || { echo "mrvis: cargo $$part is missing: run rustup component add $$name" >&2; exit 1; }; \
	done

# --- build, demo, test, install ---------------------------------------------------------------------------------------

build: setup
	cargo build --release --config 'build.rustflags=["--remap-path-prefix=$(CRATES)=crates"]'

scenes: need-furniture
	@python3 scenes/assemble.py $(SCENES) --out scenes/real

# Scenes by formula need no furniture.
demo: build $(if $(filter garden orchard valley,$(DEMO_SCENE)),,need-furniture)
	@python3 scenes/assemble.py $(DEMO_SCENE) --out scenes/real
	@mkdir -p out/demo && rm -f out/demo/bench.json
	$(BINARY) bench scenes/real/$(DEMO_SCENE).obj $(DEMO_OPTIONS) --out out/demo --json out/demo/bench.json || [ $$? = 1 ]
	@python3 .ci/headline out/demo/bench.json out/demo/report.html

# Everything that can be tested in minutes; the last lines are times by stage. After a change in one folder of src: `make test-room
# ROOM=radiosity`, for example.
test: setup-tests
	@.ci/stages

test-room: setup-tests
	@.ci/stages --room "$(ROOM)"

# What makes sense at full size alone; takes hours.
test-long: setup-tests
	@.ci/stages --long

setup-tests: setup need-lint need-browser need-hosts need-python need-libclang need-mpi

# --- the Python package: its own virtual environment; nothing else needs Python packages ------------------------------

PYTHON_DIR := $(TARGET_DIR)/python
WHEELS := $(abspath $(TARGET_DIR))/wheels

$(PYTHON_DIR)/bin/pip: | need-python
	python3 -m venv "$(PYTHON_DIR)"

python: setup $(PYTHON_DIR)/bin/pip
	"$(PYTHON_DIR)/bin/pip" -q wheel --no-deps --wheel-dir "$(WHEELS)" ./python
	@echo "mrvis: $$(ls -t "$(WHEELS)"/mrvis-*.whl | head -n 1)"

python-test: setup $(PYTHON_DIR)/bin/pip
	"$(PYTHON_DIR)/bin/pip" -q install "./python[test]"
	"$(PYTHON_DIR)/bin/pytest" -q python

# Radiance of skies and positions of the sun by the packages pvlib and pyradiance, against those that the tests store.
sky-reference: $(PYTHON_DIR)/bin/pip
	"$(PYTHON_DIR)/bin/pip" -q install pvlib pyradiance
	"$(PYTHON_DIR)/bin/python" scenes/sky_reference.py --check src/sky/tests/reference.csv

install: build need-install
	@$(MAKE) --no-print-directory install-files
	@if [ -z "$(DESTDIR)" ] && [ "$$(id -u)" = 0 ] && command -v ldconfig >/dev/null; then ldconfig; fi

# Copies BINARY and the C library without debug information, with manual pages and completions, as tests/suite/install.rs does with
# those of the tests. A private Embree is installed in lib/mrvis. All find each other relative to themselves, so PREFIX may be moved.
install-files:
	install -d "$(DESTDIR)$(PREFIX)/bin"
	install -m 755 "$(BINARY)" "$(DESTDIR)$(PREFIX)/bin/mrvis"
	strip -S "$(DESTDIR)$(PREFIX)/bin/mrvis"
	patchelf --set-rpath '$$ORIGIN/../lib/mrvis' "$(DESTDIR)$(PREFIX)/bin/mrvis"
	@ffi/package/install-library "$(LIBRARIES)" "$(DESTDIR)$(PREFIX)"
	@share="$(DESTDIR)$(PREFIX)/share"; \
	  install -d "$$share/bash-completion/completions" "$$share/zsh/site-functions" "$$share/fish/vendor_completions.d" && \
	  "$(BINARY)" completions bash > "$$share/bash-completion/completions/mrvis" && \
	  "$(BINARY)" completions zsh > "$$share/zsh/site-functions/_mrvis" && \
	  "$(BINARY)" completions fish > "$$share/fish/vendor_completions.d/mrvis.fish" && \
	  "$(BINARY)" man --out "$$share/man/man1"
	@echo "mrvis: installed $(DESTDIR)$(PREFIX)/bin/mrvis"

dist: build need-install
	@.ci/debian-packages dpkg-dev=dpkg-shlibdeps
	@rm -rf out/dist
	@$(MAKE) --no-print-directory install-files PREFIX=/usr DESTDIR="$(CURDIR)/out/dist/stage"
	@! grep -rlaF "$(CRATES)" out/dist/stage || { echo "mrvis: these files name a folder of this machine: unset RUSTFLAGS" >&2; exit 1; }
	@ffi/package/dist out/dist/stage out/dist "$(MAINTAINER)"
	@rm -rf out/dist/stage

# libFuzzer, guided by the code that is reached; `make test` runs the same readers for seconds without guidance. Inputs that
# fail are kept as target/fuzz/READER-crash-… and the like, others that reach new code in target/fuzz/corpus.
FUZZ_READERS := obj mtl ply gltf glb cache csv toml ies ldt placements
FUZZ_FLAGS := -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-trace-compares \
  -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table
FUZZ_DIR := $(TARGET_DIR)/fuzz

fuzz: setup
	host=$$(rustc -vV | sed -n 's/^host: //p') && RUSTFLAGS="$(FUZZ_FLAGS)" cargo build --release \
	  --manifest-path tests/fuzz/Cargo.toml --target $$host --target-dir "$(FUZZ_DIR)" && \
	export LD_LIBRARY_PATH="$(or $(EMBREE_DIR),.prefix/embree)/lib:$$LD_LIBRARY_PATH" && \
	for reader in $(FUZZ_READERS); do \
	  mkdir -p "$(FUZZ_DIR)/corpus/$$reader" tests/corpus/$$reader && \
	  READER=$$reader SEEDS="$(FUZZ_DIR)/corpus/$$reader" "$(FUZZ_DIR)/$$host/release/mrvis-fuzz" \
	    "$(FUZZ_DIR)/corpus/$$reader" tests/corpus/$$reader -artifact_prefix="$(FUZZ_DIR)/$$reader-" -verbosity=0 \
	    -print_final_stats=1 -max_total_time=$$(($(FUZZ_SECONDS) / $(words $(FUZZ_READERS)))) -timeout=20 -rss_limit_mb=4096 -max_len=65536 \
	    || exit 1; \
	done

kills: setup
	MRVIS_KILLS=$(KILLS) cargo test -p mrvis-command --test suite nothing_is_lost_when_the_batch_is_killed

batch-speed: setup
	cargo bench -p mrvis-command --bench batch

clean: need-cargo
	cargo clean
	rm -rf out

distclean: clean
	rm -rf .prefix scenes/real
