#!/usr/bin/env bash
# docs/results/reach_panda_slim.md: what the simulated arm can follow, lane by lane, against what `reach=panda_slim`
# lets the planners ask for. Half a minute on one core. Other arms, layouts and objects: its options, as in
#   REPORT=outputs/reach_panda scripts/measure_reach.sh --arm panda --rows 2 --cols 4 --cell-m 0.18
set -euo pipefail
cd "$(dirname "$0")/.."

export OMP_NUM_THREADS=1
"${BIN:-.venv/bin}/python" -m scripts.measure_reach --report "${REPORT:-docs/results/reach_panda_slim}" \
  --command "scripts/measure_reach.sh${*:+ $*}" "$@"
