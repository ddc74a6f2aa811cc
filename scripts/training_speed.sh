#!/usr/bin/env bash
# docs/results/training_speed.{md,csv,png}: the training loop's speed before and after the work on it, over boards, and
# on two cores; everything in turn, ROUNDS times. What is measured is kept in OUT/rows.jsonl and skipped; other
# SECONDS_EACH want another OUT. Needs a checkout with its history.
#   BIN, OUT, REPORT as in scripts/tables.sh. SECONDS_EACH: of a measurement, warmed up.
cd "$(dirname "$0")/.." && . scripts/tables.sh

out=${OUT:-outputs/training_speed}
rows=$out/rows.jsonl
seconds=${SECONDS_EACH:-15}
rounds=${ROUNDS:-2}
mkdir -p "$out"
touch "$rows"

after=$PWD
before=$(mktemp -d)
trap 'rm -rf "$before" && git worktree prune' EXIT
git worktree add --quiet --detach "$before" 01a1094

# measure TREE/NAME ARGUMENTS...: TREE is before or after; a line of rows.jsonl, unless there is one of this round.
measure() {
    local name=$1 tree=${1%%/*}
    shift
    [ "$(grep -c "\"name\": \"$name\"" "$rows")" -lt "$round" ] || return 0
    echo "== $name, round $round"
    PYTHONPATH=${!tree} "$bin/python" scripts/bench_training.py --seconds "$seconds" --name "$name" "$@" >>"$rows"
}

table4=(experiment=table4 column=8x8_z3-13)
literal=(experiment=paper/table4 paper=sequential column=8x8_z3-13 training.learning_starts=2000
    env.num_envs=256 training.updates_per_step=64)
planes=("${table4[@]}" agent.encoding=planes training.batch_size=512 env.num_envs=512)
lanes=("${table4[@]}" agent.encoding=lanes network=mlp training.batch_size=256 env.num_envs=256)
for round in $(seq "$rounds"); do
    measure before/literal "${literal[@]}"
    measure after/literal "${literal[@]}"
    measure before/planes "${planes[@]}"
    measure after/planes/float32 "${planes[@]}" training.precision=float32
    measure after/planes/bfloat16 "${planes[@]}" training.precision=bfloat16
    measure before/lanes "${lanes[@]}"
    measure after/lanes/float32 "${lanes[@]}" training.precision=float32
    measure after/lanes/bfloat16 "${lanes[@]}" training.precision=bfloat16

    # 20 % of the cells of each board.
    measure after/board/6x6 experiment=table4 layout=6x6 instances.min_obstacles=7 instances.max_obstacles=7
    measure after/board/7x7 experiment=table4 layout=7x7 instances.min_obstacles=10 instances.max_obstacles=10
    measure after/board/8x8 experiment=table4 layout=8x8 instances.min_obstacles=13 instances.max_obstacles=13
    measure after/board/10x10 experiment=table4 layout=10x10 instances.min_obstacles=20 instances.max_obstacles=20

    measure after/cores/one "${table4[@]}"
    measure after/cores/threads "${table4[@]}" threads=2
    measure after/cores/processes --processes 2 "${table4[@]}"
done
"$bin/python" -m scripts.training_speed_page "$rows" "${REPORT:-docs/results/training_speed}"
