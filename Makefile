# What one does here. `make run` and `make test` are all that a newcomer needs.

.PHONY: run test web bench accuracy verdict paper fuzz soak contract lint openapi image-check orthanc-check deny clean

# The service and its page on 127.0.0.1:8080, with a sample job already sent.
run:
	@scripts/run.sh

# Everything, with a closing count.
test:
	@scripts/test.sh

# The page and the viewer, which the program takes in when it is built. Without them it serves a page that says so.
web:
	@scripts/need.sh "make web" node page-packages
	@echo "building the page ..."
	@cd web && { told=$$(npm run --silent build -- --logLevel warn 2>&1) || { echo "$$told" >&2; exit 1; }; }

# What each stage costs at three sizes, and the whole, on one thread.
bench:
	cargo bench --locked --bench stages

# Measures how accurate the program is on shapes with a known answer, writes docs/accuracy.json, which a test
# holds, and prints it as the tables of docs/accuracy.md; a few minutes.
accuracy:
	@cargo run --quiet --locked --release --example accuracy
	@cargo run --quiet --locked --release --example accuracy -- --table

# Prints how wrong masks with known faults come out, and what the verdict says: the table in docs/quality.md.
verdict:
	@cargo run --quiet --locked --release --example accuracy -- --verdict

# Draws figures 5 to 7 of the paper into docs/paper and writes the tables of docs/paper.md; MASKS=folder draws masks of
# the same organs into target/paper too.
paper:
	@cargo run --quiet --locked --release --no-default-features --example paper
	@$(if $(MASKS),cargo run --quiet --locked --release --no-default-features --example paper -- --masks "$(MASKS)")

# Fuzzes the readers of files, parameters, forms and DICOMweb bodies, FUZZ_SECONDS each (1800), and keeps what was
# found in fuzz/corpus, which `make test` replays; needs a C++ compiler.
fuzz:
	@scripts/fuzz.sh

# The service's promises at length: hundreds of kills, stopped processes, attacks, a full disk, load. About
# ten minutes; `make test` has the short form of each. Needs root for the full disk.
soak:
	MEDIALREP_SOAK=1 cargo test --locked --release --test it -- --nocapture --test-threads=1 soak pipeline_cancel

# Holds a running service against openapi.yaml with schemathesis; needs Python.
contract:
	@scripts/contract.sh

lint:
	@scripts/need.sh "make lint" node rust c page-packages test-crates
	cd web && npm run --silent lint
	cargo fmt --check
	cargo fmt --manifest-path fuzz/Cargo.toml --check
	cargo metadata --locked --format-version 1 --manifest-path fuzz/Cargo.toml >/dev/null
	cargo clippy --locked --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --quiet --locked --no-deps

# Writes openapi.yaml anew; a test holds it equal to the routes.
openapi:
	cargo run --quiet --locked -- openapi > openapi.yaml.new && mv openapi.yaml.new openapi.yaml

# Builds the image and runs a job through it; needs root, no registry of images.
image-check:
	@scripts/image-check.sh

# Runs the recipe of examples/orthanc on a real Orthanc in a network of its own: three hooks, either side killed
# or away. LENGTH=long is away for minutes. Debian's packages; MEDIALREP_MAY_INSTALL=1 lets root install them.
orthanc-check:
	@scripts/orthanc-check.sh $(LENGTH)

# Licences, advisories and sources of all dependencies; needs cargo-deny.
deny:
	cargo deny --locked check

clean:
	cargo clean
	rm -rf data tests/tools/node_modules web/node_modules
	find web/dist -type f -not -name .gitignore -delete
