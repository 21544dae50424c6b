# make demo   installs what is needed, builds, and runs the main job
# make demo-live   the online service with a simulated camera, and its page
# make test   the same, and passes the tests; the last line is `N passed, N failed`
.PHONY: demo-live demo test test-all bench build dependencies dashboard dashboard-test format tidy install clean

JOBS ?= $(shell nproc)

demo: build
	scripts/demo.sh

demo-live: build
	scripts/demo-live.sh

test: dependencies
	scripts/test.sh

test-all: dependencies
	scripts/test.sh all

build: dependencies
	cmake --preset release
	cmake --build --preset release -j $(JOBS)

bench: build
	bench/run.sh

# The page of `knothe serve` from its sources; only those who change it need this.
dashboard: dependencies
	cd dashboard && npm ci --no-audit --no-fund && npm run build

dashboard-test: dependencies
	cd dashboard && npm ci --no-audit --no-fund && npm test

dependencies:
	@scripts/install-dependencies.sh

format:
	scripts/check-format.sh fix

tidy: build
	clang-tidy -p build/release $$(git ls-files 'knothe/*.cpp' 'apps/*.cpp')

install: build
	cmake --install build/release

clean:
	rm -rf build out
