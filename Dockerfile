# SPDX-License-Identifier: BSD-3-Clause
# docker build -t libapc .                         the programs, without what built them
# docker build -t libapc-init --target init .      the same and psql: scripts/compose-database
# docker build -t libapc-broker --target broker .  mosquitto and its clients
# --build-arg DEBIAN_IMAGE=debian@sha256:...       another Debian 12, by its digest: the same bytes each time

ARG DEBIAN_IMAGE=debian:bookworm-slim

FROM ${DEBIAN_IMAGE} AS build
RUN apt-get update \
 && apt-get install -y --no-install-recommends gcc libc6-dev cmake nodejs npm ninja-build pkg-config \
        libpq-dev libsqlite3-dev libsundials-dev libconfig-dev libsystemd-dev liblapacke-dev libnlopt-dev libxxhash-dev libssl-dev \
        libmicrohttpd-dev libjansson-dev libargon2-dev zlib1g-dev libzip-dev libexpat1-dev libmosquitto-dev \
 && rm -rf /var/lib/apt/lists/*
COPY . /src
RUN cmake -S /src -B /build -G Ninja -DAPC_TESTS=OFF \
 && cmake --build /build \
 && DESTDIR=/out cmake --install /build --strip \
 && cd /out/usr/local \
 && rm -r include lib/cmake lib/pkgconfig lib/libapc.a lib/libapc.so

FROM ${DEBIAN_IMAGE} AS base
RUN apt-get update \
 && apt-get install -y --no-install-recommends libpq5 libsqlite3-0 libconfig9 libsystemd0 liblapacke libnlopt0 libssl3 \
        libmicrohttpd12 libjansson4 libargon2-1 zlib1g libzip4 libexpat1 libmosquitto1 \
 && rm -rf /var/lib/apt/lists/*
COPY --from=build /out/ /
RUN useradd --system --uid 10001 --user-group --no-create-home --shell /usr/sbin/nologin apc \
 && install -d -m 700 -o apc -g apc /var/lib/apc /var/lib/apc-authority /var/lib/apc-plant /var/lib/apc-client /var/lib/apc-broker \
        /var/lib/apc-mqtt /var/lib/apc-queue

FROM base AS init
RUN apt-get update \
 && apt-get install -y --no-install-recommends postgresql-client-15 \
 && rm -rf /var/lib/apt/lists/*
COPY scripts/compose-certificates scripts/compose-database /usr/local/bin/
USER 10001:10001
CMD ["bash", "-c", "compose-certificates && compose-database"]

FROM ${DEBIAN_IMAGE} AS broker
RUN apt-get update \
 && apt-get install -y --no-install-recommends mosquitto mosquitto-clients \
 && rm -rf /var/lib/apt/lists/* \
 && install -d -m 700 -o 10001 -g 10001 /var/lib/apc-broker /var/lib/apc-messages
USER 10001:10001
CMD ["mosquitto", "-c", "/etc/mosquitto/apc/mosquitto.conf"]

FROM base
USER 10001:10001
CMD ["apc", "--help"]
