# The generator's image: avs3d generate, seal, validate, export with the embree renderer and the tracer.
#
#     docker build -f docker/generator.Dockerfile -t avs3d-generator:0.1.0 .
#     docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/data" avs3d-generator:0.1.0 \
#         avs3d generate manifest.yaml -o dataset --audio tracer
#
# Without the engine of SoundSpaces, whose licence is CC-BY-NC 4.0.
# Python 3.11.15 on Debian 13; the digest of all platforms that docker-library/repo-info recorded in August 2026.
# `docker buildx imagetools inspect python:3.11-slim` prints the present one.
ARG PYTHON_IMAGE=python:3.11-slim@sha256:90744cff8f32887f075c47d747a173ff333e9e98801667af93c357fa9f5e28ff
FROM ${PYTHON_IMAGE}
ARG SOURCE_DATE_EPOCH=0
ENV SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH} PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PYTHONDONTWRITEBYTECODE=1
COPY docker/build.txt docker/generator.txt /tmp/
RUN pip install --no-compile --no-deps --require-hashes -r /tmp/build.txt -r /tmp/generator.txt
COPY pyproject.toml README.md LICENSE /source/
COPY avs3d_bench /source/avs3d_bench
COPY evaluators /source/evaluators
COPY generators /source/generators
COPY baselines /source/baselines
RUN pip install --no-compile --no-deps --no-build-isolation /source && rm -r /source && useradd --uid 1000 --create-home avs3d && mkdir /data && \
    chown 1000:1000 /data
# Compiled kernels and baked homes: the user may have no home folder.
ENV HOME=/tmp NUMBA_CACHE_DIR=/tmp/numba XDG_CACHE_HOME=/tmp/cache
USER 1000:1000
WORKDIR /data
CMD ["avs3d", "--help"]
