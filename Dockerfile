# The images; the compose files say which one a service runs, and docs/operate/compose.md what each is for:
#   services    what a building needs: router, own cameras, perception, fusion, planner, gateway, recorder
#   simulation  that, and simulated buildings with their cameras and robot
#   gpu         that of services, and PyTorch, for a perception worker on a GPU
# Names and digests of your own, such as a mirror's: --build-arg BASE=registry.example/python@sha256:... It must be a Debian 12
# with Python 3.11, whose packages requirements/*.txt lock (`make lock`).
ARG BASE=python:3.11-slim-bookworm

# --- Python packages: they change seldom. Only these stages have pip. ---
FROM ${BASE} AS packages
WORKDIR /src
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PIP_ROOT_USER_ACTION=ignore
COPY requirements/services.txt requirements/
RUN pip install -q --no-deps --require-hashes --target /opt/packages -r requirements/services.txt

FROM packages AS packages-simulation
COPY requirements/simulation.txt requirements/
RUN pip install -q --no-deps --require-hashes --target /opt/packages-simulation -r requirements/simulation.txt

FROM packages AS packages-gpu
COPY requirements/gpu.txt requirements/
RUN pip install -q --no-deps --require-hashes --target /opt/packages-gpu -r requirements/gpu.txt

# --- our own code ---
FROM packages AS code
COPY requirements/build.txt requirements/
RUN pip install -q --no-deps --require-hashes --target /opt/build -r requirements/build.txt
COPY pyproject.toml README.md ./
COPY shared shared
COPY simulator simulator
COPY cli cli
COPY services services
COPY benchmark benchmark
RUN PYTHONPATH=/opt/build pip install -q --no-deps --no-build-isolation --target /opt/surveilnav .

# --- the homes and furniture of Sweet Home 3D; where Debian's mirrors can't be reached, parametric furniture stands in ---
FROM code AS furniture
RUN mkdir -p /var/cache/surveilnav && apt-get update -qq \
 && { PYTHONPATH=/opt/surveilnav:/opt/packages SURVEILNAV_CACHE_DIR=/var/cache/surveilnav \
      python -m surveilnav.simulator.furniture.assets || echo "note: no Sweet Home 3D packages in this image"; }

# --- what runs ---
FROM ${BASE} AS services
LABEL org.opencontainers.image.title="SurveilNav" org.opencontainers.image.licenses="Apache-2.0"
# A running container installs nothing: pip goes, and what Python would make it anew from.
RUN useradd --system --uid 10001 --home-dir /tmp --shell /usr/sbin/nologin surveilnav \
 && install -d -o 10001 -g 10001 /var/cache/surveilnav /var/lib/surveilnav /var/lib/recordings /etc/surveilnav \
 && find / -xdev \( -path '*/bin/pip*' -o -path '*/ensurepip/_bundled' -o -path '*/share/python-wheels' -o -path '*-packages/pip' -o -path '*-packages/pip-*' \
      -o -path '*-packages/setuptools*' -o -path '*-packages/wheel*' -o -path '*-packages/pkg_resources' \) -prune -exec rm -r {} +
COPY --from=packages /opt/packages /opt/packages
COPY --from=code /opt/surveilnav /opt/surveilnav
# Everything that a service writes lies in the volumes cache, state and recordings or in /tmp: the rest may be read-only.
ENV PATH=/opt/surveilnav/bin:$PATH \
    PYTHONPATH=/opt/surveilnav:/opt/packages \
    PYTHONUNBUFFERED=1 \
    HOME=/tmp \
    MPLCONFIGDIR=/tmp/matplotlib \
    NUMBA_CACHE_DIR=/var/cache/surveilnav/numba \
    SURVEILNAV_CACHE_DIR=/var/cache/surveilnav
WORKDIR /tmp
USER 10001:10001
CMD ["surveilnav", "--help"]

FROM services AS simulation
USER root
# Open3D loads these.
RUN apt-get update -qq \
 && apt-get install -y -qq --no-install-recommends libusb-1.0-0 libegl1 libgl1 libgomp1 libx11-6 \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/*
COPY --from=packages-simulation /opt/packages-simulation /opt/packages-simulation
COPY --from=furniture --chown=10001:10001 /var/cache/surveilnav /var/cache/surveilnav
ENV PYTHONPATH=/opt/surveilnav:/opt/packages:/opt/packages-simulation
USER 10001:10001

FROM services AS gpu
COPY --from=packages-gpu /opt/packages-gpu /opt/packages-gpu
ENV PYTHONPATH=/opt/surveilnav:/opt/packages:/opt/packages-gpu

# What `docker build .` makes.
FROM services
