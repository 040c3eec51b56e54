# The service in a container: docker compose up --build. docs/operations.md says more.
FROM python:3.11-slim-bookworm AS build
# Whichever gcc the distribution has will do: the lock files fix all that Python installs.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends gcc libc6-dev \
    && rm -rf /var/lib/apt/lists/*
RUN python -m venv /opt/cobot
WORKDIR /src
COPY requirements.lock requirements-build.lock ./
RUN /opt/cobot/bin/pip install --no-cache-dir --require-hashes \
        --requirement requirements.lock --requirement requirements-build.lock
COPY . .
RUN /opt/cobot/bin/pip install --no-cache-dir --no-build-isolation --no-deps . \
    && /opt/cobot/bin/pip uninstall --yes Cython

FROM python:3.11-slim-bookworm
COPY --from=build /opt/cobot /opt/cobot
ENV PATH=/opt/cobot/bin:$PATH
# The settings file is that of `cobot install`; the unit that comes with it lies idle here.
RUN groupadd --system --gid 990 cobot \
    && useradd --system --uid 990 --gid 990 --home-dir /var/lib/cobot cobot \
    && install --directory --owner cobot --group cobot /var/lib/cobot /var/log/cobot \
    && cobot install --prefix /
USER 990:990
WORKDIR /var/lib/cobot
EXPOSE 8007
HEALTHCHECK --interval=10s --timeout=3s --start-period=30s \
    CMD ["python", "-c", "from urllib.request import urlopen as u; u('http://127.0.0.1:8007/health/live', None, 2)"]
ENTRYPOINT ["cobot"]
CMD ["run", "--config", "/etc/cobot/cobot-setting.yaml"]
