# The workspace, built, on Debian 12; on Ubuntu 20.04 with --build-arg BASE=ros:noetic. See docs/howto/install.md.
ARG BASE=debian:12
FROM ${BASE}

RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates git make \
    && rm -rf /var/lib/apt/lists/*

COPY . /shsa
WORKDIR /shsa
RUN make build && rm -rf /var/lib/apt/lists/*

# As root nothing is started again; see docs/howto/secure.md.
RUN useradd --create-home ros
USER ros
ENTRYPOINT ["/shsa/tools/in_workspace"]
CMD ["roslaunch", "shsa_rover", "rover.launch"]
