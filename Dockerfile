# The image holds one static program and one writable folder, /data. No shell, no libraries, no root.

FROM docker.io/library/node:22-bookworm-slim AS web
WORKDIR /build/web
# Dependencies in a layer of their own, here and below: they change seldom and take most of the time.
COPY web/package.json web/package-lock.json ./
RUN npm ci
COPY openapi.yaml /build/
COPY web ./
RUN npm run build

FROM docker.io/library/rust:1.95-slim-bookworm AS build
WORKDIR /build
# Static, so that the last stage needs nothing. The target is named so that these flags are not
# used for what runs during the build.
ENV RUSTFLAGS="-C target-feature=+crt-static" CARGO_TERM_COLOR=never
RUN rustc -vV | sed -n 's/^host: //p' > /target && mkdir -p /empty

COPY Cargo.toml Cargo.lock ./
RUN mkdir src benches \
    && echo '//! Nothing yet.' > src/lib.rs \
    && echo 'fn main() {}' | tee src/main.rs > benches/stages.rs \
    && cargo build --release --locked --target "$(cat /target)" \
    && rm -r src

COPY build.rs ./
COPY migrations migrations
COPY src src
COPY --from=web /build/web/dist web/dist
RUN touch src/lib.rs src/main.rs \
    && cargo build --release --locked --target "$(cat /target)" \
    && cp "target/$(cat /target)/release/medialrep" /medialrep \
    && strip /medialrep

FROM scratch
COPY --from=build /medialrep /medialrep
COPY --from=build --chown=65532:65532 /empty /data
USER 65532:65532
# It does not start before there is a token: medialrep token create.
ENV MEDIALREP_LISTEN=0.0.0.0:8080 \
    MEDIALREP_DATA_DIR=/data \
    MEDIALREP_LOG_FORMAT=json
VOLUME ["/data"]
EXPOSE 8080
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=6s --start-period=5s CMD ["/medialrep", "probe"]
ENTRYPOINT ["/medialrep"]
CMD ["serve"]
