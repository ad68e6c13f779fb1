# semcal without MINE: `docker build -t semcal .`, and where the drive is
# `docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/data" semcal calibrate drive -o calibration.yaml`.
# EXTRAS adds others: `--build-arg EXTRAS=bag,las`.
FROM rust:1.95-slim-bookworm AS build
RUN apt-get update && apt-get install --yes --no-install-recommends python3 python3-venv \
    && rm -rf /var/lib/apt/lists/* && python3 -m venv /maturin && /maturin/bin/pip install --no-cache-dir 'maturin>=1.9.4,<2'
WORKDIR /source
COPY Cargo.toml Cargo.lock pyproject.toml README.md LICENSE ./
COPY rust rust
COPY semcal_cli semcal_cli
RUN /maturin/bin/maturin build --release --locked --out /wheels

FROM python:3.12-slim-bookworm
ARG EXTRAS=""
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels \
    wheel=$(echo /wheels/*.whl) && pip install --no-cache-dir "${wheel}${EXTRAS:+[$EXTRAS]}" \
    && useradd --create-home --uid 1000 semcal
# Matplotlib's cache, which any user may write: without it, each run warns.
ENV MPLCONFIGDIR=/tmp/matplotlib
USER semcal
WORKDIR /data
ENTRYPOINT ["semcal"]
