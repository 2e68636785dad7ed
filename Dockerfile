# satgs in a container that holds nothing but the program:
#   docker build -t satgs .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" satgs run images -o run
FROM rust:1.90-bookworm AS build
# Debian keeps the versions of its packages within a release.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends clang gdal-bin git libclang-dev pkg-config proj-data python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY . .
RUN ./scripts/build-archive \
    && mkdir /satgs \
    && tar -xzf target/archive/satgs-*.tar.gz -C /satgs --strip-components 1

FROM debian:bookworm-slim
COPY --from=build /satgs/bin /usr/local/bin
COPY --from=build /satgs/lib /usr/local/lib
COPY --from=build /satgs/share /usr/local/share
COPY --from=build /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/
COPY --from=build /satgs/LICENSE /satgs/licences.txt /usr/local/share/doc/satgs/
RUN useradd --create-home --uid 1000 satgs
USER 1000
WORKDIR /work
HEALTHCHECK CMD ["satgs", "--version"]
ENTRYPOINT ["satgs"]
CMD ["--help"]
