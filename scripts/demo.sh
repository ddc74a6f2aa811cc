#!/usr/bin/env bash
# Everything, end to end: train, evaluate, plan, draw, execute. Arguments are overrides of the training:
#   scripts/demo.sh training.max_minutes=0.5
# BIN: where the commands are; LIMIT: how many test instances are evaluated; OUT: where everything goes.
set -euo pipefail
cd "$(dirname "$0")/.."

bin=${BIN:-.venv/bin}
limit=${LIMIT:-1000}
out=${OUT:-outputs/demo}
SECONDS=0

if [ -e "$out" ]; then
    # Only the folder of a demo is removed.
    [ -f "$out/train/config.yaml" ] || { echo "demo.sh: OUT: $out exists and is not the folder of a demo, want another" >&2; exit 2; }
    echo "== replacing the last demo in $out"
    rm -rf "$out"
fi

echo "== 1/4 train: the separated DQN, 3 x 6 cells, 3 to 7 obstacles, the simulated arm's reach"
"$bin/dore-train" experiment=demo run_dir="$out/train" "$@"

echo "== 2/4 evaluate: $limit test instances, beside the straight-line baseline"
"$bin/dore-evaluate" model="$out/train" run_dir="$out/evaluate" limit="$limit"

echo "== 3/4 plan: the scene of the paper's Fig. 7; the plan is replayed before it is written"
"$bin/dore-plan" model="$out/train" planner=learned scene=fig7 out="$out/plan.json" || {
    code=$?
    echo "demo.sh: no plan for this scene (exit code $code); train longer" >&2
    exit "$code"
}

echo "== 4/4 execute: the plan on the simulated arm"
executed=0
"$bin/dore-execute" plan="$out/plan.json" run_dir="$out/execute" || executed=$?

echo
echo "== $SECONDS s in all; what was made:"
find "$out" -name '*.png' -o -name '*.mp4' -o -name plan.json -o -name rows.csv -o -name execution.json | sort
exit "$executed"
