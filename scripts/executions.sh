#!/usr/bin/env bash
# docs/results/execution.{md,csv}: 300 scenes carried out open loop, 100 by the camera alone, 100 with one disturbance
# each (an object moved, a grasp that slips, a stranger's object, in turn). The closed loops need a Vulkan driver.
# What is done is skipped. BIN: where python is. OUT: where the runs go. RUNS: scenes a number of obstacles.
set -euo pipefail
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1

python=${BIN:-.venv/bin}/python
out=${OUT:-outputs/executions}
runs=${RUNS:-100}
closed=$(((runs + 2) / 3))
"$python" -m scripts.executions "$out/open" --obstacles 5,7,9 --runs "$runs" --workers "${WORKERS:-2}"
"$python" -m scripts.executions "$out/closed" --obstacles 5,7,9 --runs "$closed" --loop closed --workers "${WORKERS:-2}"
"$python" -m scripts.executions "$out/disturbed" --obstacles 5,7,9 --runs "$closed" --loop closed --disturbance mixed --workers "${WORKERS:-2}"
"$python" -m scripts.execution_report "${REPORT:-docs/results/execution}" scripts/executions.sh \
    "Open loop=$out/open" "Closed loop, by the camera alone=$out/closed" "Closed loop, one disturbance each=$out/disturbed"
