#!/usr/bin/env bash
# docs/results/execution.{md,csv}: 300 scenes carried out open loop; 102 by the camera alone, 102 with one disturbance
# each (an object moved, a grasp that slips, an intruder's object, in turn), 102 with objects up to 1 cm off the middles
# of their cells and turned by any angle. The closed loops need a Vulkan driver.
# What is done is skipped. BIN: where python is. OUT: where the runs go. RUNS: scenes a number of obstacles.
set -euo pipefail
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1

python=${BIN:-.venv/bin}/python
out=${OUT:-outputs/executions}
runs=${RUNS:-100}
closed=$(((runs + 2) / 3))
run() { "$python" -m scripts.executions "$out/$1" --obstacles 5,7,9 --workers "${WORKERS:-2}" "${@:2}"; }
run open --runs "$runs"
run closed --runs "$closed" --loop closed
run disturbed --runs "$closed" --loop closed --disturbance mixed
run turned --runs "$closed" --loop closed --set jitter_m=0.01 --set turned=true
"$python" -m scripts.execution_report "${REPORT:-docs/results/execution}" scripts/executions.sh \
    "Open loop=$out/open" "Closed loop, by the camera alone=$out/closed" \
    "Closed loop, one disturbance each=$out/disturbed" \
    "Closed loop, objects off their cells' middles and turned=$out/turned"
