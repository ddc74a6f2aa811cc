#!/usr/bin/env bash
# docs/results/execution_time.{md,csv,png}: Table 2's execution time, 50 scenes a column, each carried out with the
# baseline's plan and with the learned one. What is done is skipped. BIN, OUT, REPORT, RUNS as in scripts/executions.sh.
set -euo pipefail
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1

python=${BIN:-.venv/bin}/python
out=${OUT:-outputs/execution_time}
for planner in straight_line learned; do
    "$python" -m scripts.executions "$out/$planner" --obstacles "${COLUMNS:-3,4,5,6,7,8,9}" --runs "${RUNS:-50}" \
        --planner "$planner" --solved-by straight_line,learned --workers "${WORKERS:-2}"
done
"$python" -m scripts.execution_time "${REPORT:-docs/results/execution_time}" "$out/straight_line" "$out/learned"
