# One image for every service; compose.yaml says which one a container runs. The target `gpu` is the same with torch.

# --- Python packages: they change seldom ---
FROM python:3.11-slim-bookworm AS packages
RUN python -m venv /opt/venv
ENV PATH=/opt/venv/bin:$PATH
WORKDIR /src
COPY pyproject.toml constraints.txt README.md ./
COPY shared/surveilnav/__init__.py shared/surveilnav/
RUN pip install -q --no-cache-dir -c constraints.txt ".[simulator,mesh]" && pip uninstall -q -y surveilnav

# --- the same with torch and its models, gigabytes of them: only for the target gpu ---
FROM packages AS packages-gpu
RUN pip install -q --no-cache-dir -c constraints.txt ".[simulator,mesh,perception-torch,mobile-sam]" && pip uninstall -q -y surveilnav

# --- our own code, and the homes and furniture of Sweet Home 3D ---
FROM packages AS code
COPY shared shared
COPY simulator simulator
COPY cli cli
COPY services services
COPY benchmark benchmark
RUN pip install -q --no-cache-dir --no-deps --target /opt/surveilnav .
# Where Debian's mirrors can't be reached, parametric furniture stands in.
RUN mkdir -p /var/cache/surveilnav && apt-get update -qq \
 && { PYTHONPATH=/opt/surveilnav SURVEILNAV_CACHE_DIR=/var/cache/surveilnav python -m surveilnav.simulator.furniture.assets \
      || echo "note: no Sweet Home 3D packages in this image"; }

# --- what runs, but for the packages ---
FROM python:3.11-slim-bookworm AS base
LABEL org.opencontainers.image.title="SurveilNav" org.opencontainers.image.licenses="Apache-2.0"
RUN apt-get update \
 && apt-get install -y --no-install-recommends libusb-1.0-0 libegl1 libgl1 libgomp1 libx11-6 \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --system --uid 10001 --home-dir /tmp --shell /usr/sbin/nologin surveilnav \
 && install -d -o 10001 -g 10001 /var/lib/surveilnav /var/lib/recordings
COPY --from=code --chown=10001:10001 /var/cache/surveilnav /var/cache/surveilnav
COPY --from=code /opt/surveilnav /opt/surveilnav
# Everything that a service writes lies in the volumes cache, state and recordings or in /tmp: the rest may be read-only.
ENV PATH=/opt/surveilnav/bin:/opt/venv/bin:$PATH \
    PYTHONPATH=/opt/surveilnav \
    PYTHONUNBUFFERED=1 \
    HOME=/tmp \
    MPLCONFIGDIR=/tmp/matplotlib \
    NUMBA_CACHE_DIR=/var/cache/surveilnav/numba \
    SURVEILNAV_CACHE_DIR=/var/cache/surveilnav
WORKDIR /tmp
USER 10001:10001
CMD ["surveilnav", "--help"]

# --- a perception worker on a GPU: `docker build --target gpu .` ---
FROM base AS gpu
COPY --from=packages-gpu /opt/venv /opt/venv

# --- everything else ---
FROM base
COPY --from=packages /opt/venv /opt/venv
