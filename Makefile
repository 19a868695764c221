# `make help` lists the targets. Variables: ARGS (additional arguments of the program or the
# script), ADVISORIES, AUDITS, SESSION, TABLE_SESSION, TEMPLE_SESSION, TRUTH, RIGS, CARGO_TARGET_DIR; REV,
# CASES, PAIRS (bench-compare); SCHEDULES (model).
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.NOTPARALLEL:
.DEFAULT_GOAL := help

TARGET := $(or $(CARGO_TARGET_DIR),target)
PENUMBRA := $(TARGET)/release/penumbra
SESSION ?= tests/fixtures/sessions/desk.mcap
TABLE_SESSION ?= tests/fixtures/sessions/tea-table.mcap
TEMPLE_SESSION ?= tests/fixtures/sessions/courtyard.mcap
TRUTH ?= ../shared/truth
RIGS ?= ../shared/rigs
# The webcam's rig: name of the camera, ball's diameter, paper, measured length of the printed line.
CAMERA ?= auto
BALL_MM ?= 70
PAPER ?= a4
RULER_MM ?= 100
# Schedules of the model checker.
SCHEDULES ?= 20000
PREFIX ?= /usr/local
SYSCONFDIR ?= /etc
UNITDIR ?= /etc/systemd/system
UDEVDIR ?= /etc/udev/rules.d
# Completions of bash, zsh and fish, under $(PREFIX)/share.
COMPLETIONS := bash-completion/completions/penumbra zsh/site-functions/_penumbra fish/vendor_completions.d/penumbra.fish
# Mesa's device-select layer complains on machines without a desktop; Penumbra sorts adapters
# itself. Then: packages that were unpacked without root (.ci/packages --no-root).
export NODEVICE_SELECT ?= 1
UNPACKED := if [ -f target/packages/env ]; then . target/packages/env; fi;
# A window needs a display; without one the picture is shown in the browser.
WINDOW := $(if $(DISPLAY)$(WAYLAND_DISPLAY),,--headless)

# Opens the status page of a demo as soon as it answers, where there is a browser to open it with.
ON_PAGE := On the page, Compare wipes between the camera and the composite, and Move objects lets you drag virtual objects. Ctrl-C ends the demo.
DEMO_PAGE := http://127.0.0.1:8780
OPEN_PAGE := if [ -n "$(DISPLAY)$(WAYLAND_DISPLAY)" ] && command -v xdg-open >/dev/null; then \
  (for _ in $$(seq 60); do curl -sf $(DEMO_PAGE)/healthz >/dev/null && { xdg-open $(DEMO_PAGE) >/dev/null 2>&1; break; }; sleep 1; done) & fi

.PHONY: announce help demo demo-desk demo-temple demo-lamp demo-webcam build test check docs docs-write unit advisories bench bench-table bench-compare gpu-check fidelity near-lamps calibration faults soak fuzz fmt packages-demo packages-test toolchain clean install uninstall deb tarball deb-proof test-devices cross power-cut service-proof viewers model miri sanitize vet sbom

help: ## This list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

demo: announce packages-demo build ## Install missing packages, build, replay a tea table under a carried lamp, open its page or print the address
	@echo "Mirrored ball, gold ring, green knot and clay head are virtual. $(ON_PAGE)"
	@$(OPEN_PAGE)
	@$(UNPACKED) exec $(PENUMBRA) replay $(TABLE_SESSION) --config config/demo.toml --loop $(WINDOW) $(ARGS)

demo-desk: announce packages-demo build ## A teapot on a desk at 640×480 pixels, the fastest one
	@echo "The teapot is virtual. $(ON_PAGE)"
	@$(OPEN_PAGE)
	@$(UNPACKED) exec $(PENUMBRA) replay $(SESSION) --config config/demo-desk.toml --loop $(WINDOW) $(ARGS)

demo-temple: announce packages-demo build ## The same outdoors: a temple gate, baked shadowing planes, changing daylight
	@echo "The gate is virtual; the afternoon passes in six seconds. $(ON_PAGE)"
	@$(OPEN_PAGE)
	@$(UNPACKED) exec $(PENUMBRA) replay $(TEMPLE_SESSION) --config config/demo-temple.toml --loop $(WINDOW) $(ARGS)

demo-lamp: announce packages-demo build ## The same with a virtual lamp that lights a table, moves and is switched off and on
	@echo "Ball, cone and lamp are virtual; the lamp lights the real table. $(ON_PAGE)"
	@$(OPEN_PAGE)
	@$(UNPACKED) exec $(PENUMBRA) replay $(SESSION) --config config/demo-lamp.toml --loop $(WINDOW) $(ARGS)

demo-webcam: announce packages-demo build ## Your own webcam, a printed sheet and a shiny ball; CAMERA=/dev/video0 BALL_MM=70 PAPER=letter RULER_MM=98
	@$(OPEN_PAGE)
	@$(UNPACKED) exec $(PENUMBRA) webcam --camera "$(CAMERA)" --ball-mm "$(BALL_MM)" --paper "$(PAPER)" --ruler-mm "$(RULER_MM)" --headless $(ARGS)

announce:
	@test -e $(PENUMBRA) || echo 'The first build takes 5 to 15 minutes on two cores; cargo shows how far it is. Later ones take seconds.'

build: toolchain ## The program, optimised: target/release/penumbra
	@$(UNPACKED) cargo build --release --locked --bin penumbra

test: packages-test toolchain ## Install missing packages, run all tests, compare pictures with path-traced ground truth
	@$(UNPACKED) .ci/test test

check: packages-test toolchain ## Formatting, lints, documentation, spelling, licences
	@$(UNPACKED) .ci/test check

docs: toolchain ## The book: target/book/index.html
	@$(UNPACKED) .ci/book

docs-write: ## Rewrite the generated pages of the book: configuration, command line, status API, schema of rig.json
	@$(UNPACKED) UPDATE_DOCS=1 cargo test --quiet -p penumbra-config -p penumbra-status -p penumbra-rig-model _page
	@$(UNPACKED) UPDATE_DOCS=1 cargo test --quiet --bin penumbra command_line_page

unit: toolchain ## Rust tests alone
	@$(UNPACKED) .ci/test rust

test-devices: toolchain ## Real kernel cameras and serial ports, in a small VM; ARGS="environment kernel program serial"
	@tests/devices/run $(ARGS)

cross: toolchain ## Compile for Windows (MinGW) and macOS (Rust only), as far as the targets are installed
	@$(UNPACKED) .ci/test cross

power-cut: toolchain ## Cut the power of a recording rig in a VM, at a hundred instants; ARGS="--seconds 20 --cuts 100 --write"
	@python3 tests/devices/power_cut.py $(ARGS)

service-proof: build ## Start the service under a real systemd, Debian 12 in a VM: READY, watchdog, crash (root, debootstrap)
	@tests/devices/service-proof $(PENUMBRA)

viewers: build ## A thousand viewers of the live picture, a hundred of them stalled, beside a replay; ARGS="--pairs 7 --write"
	@$(UNPACKED) python3 tests/judge/viewers.py --penumbra $(PENUMBRA) $(ARGS)

advisories: toolchain ## Known vulnerabilities of dependencies; needs the network, or ADVISORIES=FOLDER, a copy of the list
	@.ci/test advisories

vet: toolchain ## Every dependency has an audit or an exemption; AUDITS=FOLDER lists published audits in the documentation
	@.ci/test vet
	@$(if $(AUDITS),python3 tests/judge/supply_chain.py --audits "$(AUDITS)" --write)

sbom: toolchain ## The libraries in the program with their licences (CycloneDX): target/sbom.cdx.json
	@.ci/deb --sbom $(TARGET)/sbom.cdx.json

bench: build ## The paper's table 1 on this machine, and the cost of capturing; ARGS="--case supan --json FILE"
	@$(UNPACKED) $(PENUMBRA) bench $(ARGS)

bench-table: build ## Measure the papers' rows and write them to docs/src/results/bench.md
	@for case in supan kakuta2007 kakuta2004 lightprobe live; do \
	  $(UNPACKED) $(PENUMBRA) bench --case $$case --json $(TARGET)/bench-$$case.json --force $(ARGS); done
	@$(UNPACKED) $(PENUMBRA) bench --case live --size 1280x720 --json $(TARGET)/bench-live-720.json --force $(ARGS)
	@python3 tests/judge/bench_table.py $(addprefix $(TARGET)/bench-,supan.json kakuta2007.json kakuta2004.json lightprobe.json live.json live-720.json) --start $(PENUMBRA) $(SESSION)

bench-compare: build ## Build revision REV and run both benchmarks in turns; CASES=supan,live PAIRS=7 ARGS="--frames 60"
	@$(UNPACKED) python3 tests/judge/bench_compare.py "$(REV)" --penumbra $(PENUMBRA) $(if $(CASES),--cases $(CASES)) $(if $(PAIRS),--pairs $(PAIRS)) --bench $(ARGS)

gpu-check: build ## Tests, benchmarks, latency and fidelity on this adapter, one report: target/gpu-check/report.md
	@$(UNPACKED) python3 tests/judge/gpu_check.py --penumbra $(PENUMBRA) --truth $(TRUTH) $(RIGS) $(ARGS)

fidelity: build ## Compare pictures with path-traced ground truth; ARGS="--sessions desk.mcap --no-planes"
	@$(UNPACKED) python3 tests/judge/fidelity.py --penumbra $(PENUMBRA) --truth $(TRUTH) $(RIGS) $(ARGS)

near-lamps: build ## What estimated places of lamps change, with wrong descriptions of a rig, too; ARGS="--truth DIR"
	@$(UNPACKED) python3 tests/judge/near_lamps.py --penumbra $(PENUMBRA) $(ARGS)

calibration: build ## Compare calibration and registration with known references; ARGS="--simulated DIR --only intrinsics"
	@$(UNPACKED) python3 tests/judge/calibration.py --penumbra $(PENUMBRA) --truth $(TRUTH) $(ARGS)

faults: toolchain ## Inject 20 kinds of fault, 100 times each, into a live rig; ARGS="--rounds 5 --write"
	@$(UNPACKED) python3 tests/judge/faults.py $(ARGS)

soak: build ## Long: memory must stay constant over 10,000 frames of a looped replay
	@$(UNPACKED) python3 tests/judge/soak.py $(PENUMBRA) $(SESSION) $(ARGS)

model: toolchain ## Check the queues of hub and recorder under SCHEDULES=20000 schedules of two kinds, each model
	@$(UNPACKED) PENUMBRA_MODEL_SCHEDULES=$(SCHEDULES) .ci/test model

miri: toolchain ## Unsafe code under Miri (needs a nightly toolchain with Miri)
	@$(UNPACKED) tests/miri/run

sanitize: toolchain ## A live rig, a replay and the tests of queues and unsafe code under the address and the thread sanitizer; long; ARGS=thread (needs a nightly toolchain)
	@$(UNPACKED) tests/sanitize/run $(ARGS)

fuzz: toolchain ## Fuzz protocols, sessions, files, pictures and HTTP; FUZZ_SECONDS=30 each, ARGS="fastrak csv", --minimise, --write
	@tests/fuzz/run $(ARGS)

install: ## Program, man pages, completions, service, udev rules, user; DESTDIR= PREFIX=/usr/local SYSCONFDIR=/etc. Build first
	@test -x $(PENUMBRA) || { echo "build first: make build" >&2; exit 1; }
	install -D -m 755 $(PENUMBRA) $(DESTDIR)$(PREFIX)/bin/penumbra
	$(PENUMBRA) man $(TARGET)/man --force
	install -d $(DESTDIR)$(PREFIX)/share/man/man1
	install -m 644 $(TARGET)/man/penumbra*.1 $(DESTDIR)$(PREFIX)/share/man/man1/
	install -d $(addprefix $(DESTDIR)$(PREFIX)/share/,$(dir $(COMPLETIONS)))
	$(PENUMBRA) completions bash > $(DESTDIR)$(PREFIX)/share/$(word 1,$(COMPLETIONS))
	$(PENUMBRA) completions zsh > $(DESTDIR)$(PREFIX)/share/$(word 2,$(COMPLETIONS))
	$(PENUMBRA) completions fish > $(DESTDIR)$(PREFIX)/share/$(word 3,$(COMPLETIONS))
	sed -e 's#@PREFIX@#$(PREFIX)#g' -e 's#@SYSCONFDIR@#$(SYSCONFDIR)#g' systemd/penumbra.service.in > $(TARGET)/penumbra.service
	install -D -m 644 $(TARGET)/penumbra.service $(DESTDIR)$(UNITDIR)/penumbra.service
	install -D -m 644 systemd/70-penumbra.rules $(DESTDIR)$(UDEVDIR)/70-penumbra.rules
	install -D -m 644 systemd/penumbra.sysusers $(DESTDIR)$(PREFIX)/lib/sysusers.d/penumbra.conf
	install -d $(DESTDIR)$(SYSCONFDIR)/penumbra
	test -e $(DESTDIR)$(SYSCONFDIR)/penumbra/rig.toml || install -m 644 config/rig.toml $(DESTDIR)$(SYSCONFDIR)/penumbra/rig.toml
	@$(if $(DESTDIR),,systemd-sysusers; systemctl daemon-reload; udevadm control --reload; udevadm trigger -s video4linux -s tty -s usb-serial; echo "edit $(SYSCONFDIR)/penumbra/rig.toml, then: systemctl enable --now penumbra")

deb: build ## A Debian package with documentation, sessions and licences: target/penumbra_VERSION_ARCH.deb
	@$(UNPACKED) .ci/deb --penumbra $(PENUMBRA) --out $(TARGET) $(ARGS)

tarball: build ## The same files as a tarball: target/penumbra-VERSION-ARCH.tar.xz
	@$(UNPACKED) .ci/deb --penumbra $(PENUMBRA) --out $(TARGET) --tarball $(ARGS)

deb-proof: deb tarball ## Install the package and the tarball into a bare Debian 12 and run the program there (root, debootstrap)
	@.ci/deb-proof $(TARGET)/penumbra_*.deb $(TARGET)/penumbra-*.tar.xz

uninstall: ## Remove the installed files, but not $(SYSCONFDIR)/penumbra and recordings
	@$(if $(DESTDIR),,systemctl disable --now penumbra 2>/dev/null || true)
	rm -f $(DESTDIR)$(PREFIX)/bin/penumbra $(DESTDIR)$(UNITDIR)/penumbra.service
	rm -f $(DESTDIR)$(UDEVDIR)/70-penumbra.rules $(DESTDIR)$(PREFIX)/lib/sysusers.d/penumbra.conf
	rm -f $(DESTDIR)$(PREFIX)/share/man/man1/penumbra.1 $(DESTDIR)$(PREFIX)/share/man/man1/penumbra-*.1
	rm -f $(addprefix $(DESTDIR)$(PREFIX)/share/,$(COMPLETIONS))
	@$(if $(DESTDIR),,systemctl daemon-reload; udevadm control --reload; userdel penumbra 2>/dev/null || true)

fmt: ## Format all Rust
	cargo fmt --all

clean: ## Remove build outputs
	cargo clean

toolchain:
	@if ! command -v cargo >/dev/null; then \
	  echo "cargo is missing: curl --proto =https -sSf https://sh.rustup.rs | sh -s -- -y && . ~/.cargo/env" >&2; exit 1; fi

packages-demo:
	@.ci/packages demo

packages-test:
	@.ci/packages test
