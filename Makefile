# make demo        installs what the programs need, builds them, and runs the main job
# make demo-live   the same with the online service, a simulated camera, and its page
# make docs        the documentation as pages for a browser: build/docs/index.html
# make packages    Debian packages of all of it, for any machine: build/packages/*.deb
# make wheel       the package for Python with all that it needs, for any Linux: build/wheel/*.whl
# make release     those, the source archive, what is in them, checksums: build/release-VERSION/
# make test        everything in release and its tests, the long ones in a short form; the last line is `N passed, N failed`
# make check       their long forms, address and undefined-behaviour sanitizers on the online rooms, fuzzers on the parsers; likewise
# make test-all    all of it with full counts and every check, the thread sanitizer, packages and both commands in an empty Debian: a night
# Each installs what it needs itself (scripts/packages.txt).
.PHONY: demo demo-live docs packages wheel release test check test-all bench build dependencies dashboard dashboard-test format tidy install clean

JOBS ?= $(shell nproc)

demo: build
	scripts/demo.sh

demo-live: build
	scripts/demo-live.sh

# Debian's Sphinx belongs to Debian's interpreter.
docs:
	@scripts/install-dependencies.sh docs
	/usr/bin/python3 -m sphinx -b html -W --keep-going -q -d build/docs.cache docs build/docs
	@echo "Open $(CURDIR)/build/docs/index.html"

packages:
	@scripts/install-dependencies.sh build package
	scripts/packages.sh

wheel:
	@scripts/install-dependencies.sh build package
	scripts/wheel.sh

release:
	@scripts/install-dependencies.sh build package
	scripts/release.sh

test:
	@scripts/install-dependencies.sh build test
	scripts/test.sh release

check:
	@scripts/install-dependencies.sh build test check
	scripts/test.sh release-slow asan fuzz

test-all: packages wheel
	@scripts/install-dependencies.sh build test check
	scripts/test.sh release-full asan-all tsan fuzz-full

# The programs only, in a new folder without the tests.
build: dependencies
	scripts/configure.sh release $(if $(wildcard build/release/CMakeCache.txt),,-DBUILD_TESTING=OFF)
	cmake --build --preset release -j $(JOBS) --target programs

bench: build
	@scripts/install-dependencies.sh bench
	bench/run.sh

# The page of `knothe serve` from its sources; only those who change it need this.
dashboard:
	@scripts/install-dependencies.sh page
	cd dashboard && npm ci --no-audit --no-fund && npm run build

dashboard-test:
	@scripts/install-dependencies.sh page
	cd dashboard && npm ci --no-audit --no-fund && npm test

dependencies:
	@scripts/install-dependencies.sh build

format:
	@scripts/install-dependencies.sh format
	scripts/check-format.sh fix

tidy: build
	@scripts/install-dependencies.sh tidy
	clang-tidy -p build/release $$(git ls-files 'knothe/*.cpp' 'apps/*.cpp')

install: build
	cmake --build --preset release -j $(JOBS)
	cmake --install build/release

clean:
	rm -rf build out
