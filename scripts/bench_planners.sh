#!/usr/bin/env bash
# docs/results/planners.md: latencies and throughput of the planners. Parts b and d take
# long. One part alone: --parts a; a model of your own for b and c: --learned-model outputs/mine; --help says the rest.
set -euo pipefail
cd "$(dirname "$0")/.."

bin=${BIN:-.venv/bin}
export OMP_NUM_THREADS=1
"$bin/python" -m scripts.bench_planners --out "${REPORT:-docs/results/planners.md}" "$@"
