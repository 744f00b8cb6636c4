# docker build -t etude . && docker run --rm -v "$PWD:/work" etude demo
FROM python:3.11-slim
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY src src
COPY examples examples
RUN pip install --no-cache-dir .
WORKDIR /work
ENTRYPOINT ["etude"]
