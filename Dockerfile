# delam_fem on Debian 12, as scripts/setup.sh installs it.
#   docker build -t delam_fem .
#   docker run --rm -v "$PWD":/data delam_fem run default -o /data/run
FROM debian:bookworm
ENV PIP_NO_CACHE_DIR=1
COPY . /opt/delam_fem
RUN apt-get update \
    && /opt/delam_fem/scripts/setup.sh \
    && rm -rf /var/lib/apt/lists/*
ENV PATH=/opt/delam_fem/.venv/bin:$PATH
WORKDIR /data
ENTRYPOINT ["delam-fem"]
