# docker build -t locate .
# docker run --rm -v "$PWD:/data" locate run /data/video.mp4 -o /data/out
FROM python:3.11-slim-bookworm AS build
WORKDIR /src
COPY pyproject.toml constraints.txt README.md LICENSE NOTICE ./
COPY geometry geometry
COPY detect detect
COPY locate locate
ENV PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt
RUN python -m venv /opt/locate \
    && /opt/locate/bin/pip install --no-cache-dir .
COPY .ci/slim .ci/slim
RUN .ci/slim /opt/locate

FROM python:3.11-slim-bookworm
RUN apt-get update \
    && apt-get install -y --no-install-recommends libegl1 libgl1 libidn2-0 libudev1 libx11-6 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home locate
COPY --from=build /opt/locate /opt/locate
ENV PATH=/opt/locate/bin:$PATH
USER locate
WORKDIR /data
ENTRYPOINT ["locate"]
CMD ["--help"]
