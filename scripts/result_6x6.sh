#!/usr/bin/env bash
# docs/results/6x6.md: the separated DQN on 6 x 6, 3 to 8 obstacles, ten minutes of training on one core, then
# 5,000 instances of the test split beside the proved optimum and the baseline.
set -euo pipefail
cd "$(dirname "$0")/.."

bin=${BIN:-.venv/bin}
out=${OUT:-outputs/6x6}
"$bin/dore-train" experiment=6x6 run_dir="$out/train"
"$bin/dore-evaluate" model="$out/train" instances=z3-8 instances.test_size=5000 timing=batched \
    planner='[exact,learned,straight_line]' run_dir="$out/test"
"$bin/python" scripts/report_run.py "$out" docs/results/6x6 "scripts/result_6x6.sh"
