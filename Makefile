# The front door. `make demo` and `make test` do all of their own set-up; `make help` lists the rest.

PREFIX ?= /usr/local
SCENES ?= livingroom kitchen office park sponza
# What `make demo` measures, and how long it takes over it: with these, a minute or so of tracing on one core.
DEMO_SCENE ?= livingroom
DEMO_OPTIONS ?= --points 8000 --reference-rays 512

TARGET_DIR := $(or $(CARGO_TARGET_DIR),target)
BINARY := $(TARGET_DIR)/release/mrvis
RUST_VERSION := 1.89

# rustup's folder is on the PATH of a login shell, but not always on that of a script.
export PATH := $(PATH):$(HOME)/.cargo/bin
SHELL := /bin/bash

.PHONY: help demo test build scenes install clean distclean
.PHONY: setup need-cargo need-packages need-embree need-furniture need-lint
.DEFAULT_GOAL := help

help:
	@echo "mrvis: visibility and radiosity in scenes full of small detail"
	@echo
	@echo "  make demo      set up, build, assemble a real room, measure it, name the report"
	@echo "  make test      set up, then format, lint, documentation and the whole test suite"
	@echo "  make build     set up and build the command ($(BINARY))"
	@echo "  make scenes    assemble the real scenes in scenes/real (some: make scenes SCENES=\"park sponza\")"
	@echo "  make install   install the command under PREFIX (now $(PREFIX))"
	@echo "  make clean     remove what was built and the reports; distclean: also scenes and the private Embree"
	@echo
	@echo "Embree 4 is taken from EMBREE_DIR if that is set, else from the system, else fetched into .prefix."

# --- set-up: each step says what it does and does nothing when it is done ---------------------------------------------

setup: need-cargo need-packages need-embree

need-cargo:
	@command -v cargo >/dev/null 2>&1 || { \
	  echo "mrvis: cargo was not found: install Rust $(RUST_VERSION) or newer with rustup, then try again" >&2; \
	  echo "mrvis: (Debian 13 and later: apt-get install rustup, then rustup default stable)" >&2; exit 1; }
	@have=$$(cargo --version | cut -d' ' -f2); \
	  [ "$$(printf '%s\n' $(RUST_VERSION) "$$have" | sort -V | head -n 1)" = $(RUST_VERSION) ] || { \
	  echo "mrvis: cargo is $$have, Rust $(RUST_VERSION) or newer is needed: rustup update stable" >&2; exit 1; }

need-packages:
	@.ci/debian-packages g++=g++ gcc=cc python3=python3 $(if $(LIBCLANG_PATH),,libclang-dev)

need-embree: need-packages
	@ffi/embree/get-embree.sh

need-furniture: need-packages
	@[ -d /usr/share/sweethome3d/furniture ] || .ci/debian-packages sweethome3d-furniture

need-lint: need-cargo
	@for part in fmt clippy; do \
	  cargo $$part --version >/dev/null 2>&1 && continue; \
	  name=$${part/fmt/rustfmt}; echo "mrvis: adding the Rust component $$name" >&2; \
	  rustup component add $$name || { echo "mrvis: cargo $$part is missing: rustup component add $$name" >&2; exit 1; }; \
	done

# --- what it is for ---------------------------------------------------------------------------------------------------

build: setup
	cargo build --release

scenes: need-furniture
	@python3 scenes/assemble.py $(SCENES) --out scenes/real

demo: build need-furniture
	@python3 scenes/assemble.py $(DEMO_SCENE) --out scenes/real
	@mkdir -p out/demo && rm -f out/demo/bench.json
	$(BINARY) bench scenes/real/$(DEMO_SCENE).obj $(DEMO_OPTIONS) --out out/demo --json out/demo/bench.json || [ $$? = 1 ]
	@python3 .ci/headline out/demo/bench.json out/demo/report.html

# The tests come last: their result lines end the output.
test: setup need-lint
	cargo fmt --check
	cargo clippy --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps
	cargo test

# The command finds a private Embree beside itself, in ../lib/mrvis, wherever PREFIX is moved to.
install: setup
	cargo rustc --release --bin mrvis -- -C 'link-arg=-Wl,-rpath,$$ORIGIN/../lib/mrvis'
	install -d "$(DESTDIR)$(PREFIX)/bin"
	install -m 755 $(BINARY) "$(DESTDIR)$(PREFIX)/bin/mrvis"
	@if ldd $(BINARY) | grep -q '/\.prefix/embree/lib/'; then \
	  install -d "$(DESTDIR)$(PREFIX)/lib/mrvis" && \
	  cp -P .prefix/embree/lib/lib* "$(DESTDIR)$(PREFIX)/lib/mrvis/" && \
	  cp .prefix/embree/share/doc/* "$(DESTDIR)$(PREFIX)/lib/mrvis/" && \
	  echo "mrvis: its Embree 4 is in $(DESTDIR)$(PREFIX)/lib/mrvis"; fi
	@echo "mrvis: installed $(DESTDIR)$(PREFIX)/bin/mrvis"

clean: need-cargo
	cargo clean
	rm -rf out

distclean: clean
	rm -rf .prefix scenes/real
