#!/usr/bin/env bash
# docs/results/generalist.{csv,md,png}, q_values.png and failures.{md,png}: what the one network in the package does,
# without retraining, on sizes, densities and reaches that it has learned from and that it has never seen; what it
# thinks; where it fails. What is done is skipped, and what older weights have done is made again. tables.sh has BIN.
#   OUT: where the evaluations go. REPORTS: where the pages and pictures go. MODEL: other weights.
#   TEST_SIZE: instances of each world. SIZES: ROWSxCOLS, with @METRES where the cells are not the reach's usual ones.
#   DENSITIES: per cent of the cells. REACHES, REACH_SIZES, REACH_DENSITIES: the worlds of other reaches.
#   FAILURE_BOARDS: how many boards of each column the failures are looked for on.
cd "$(dirname "$0")/.." && . scripts/tables.sh

out=${OUT:-outputs/generalist}
reports=${REPORTS:-docs/results}
weights=${MODEL:-dore/weights/generalist.safetensors}
test_size=${TEST_SIZE:-200}

# measure REACH SIZE PERCENT: the proved optimum once for all weights, and what these weights do.
measure() {
    local reach=$1 size=${2%@*} percent=$3 folder=$out/$1/$2_$3 world
    local rows=${size%x*} cols=${size#*x}
    local obstacles=$(((rows * cols * percent + 50) / 100))
    world=(layout=3x6 layout.rows="$rows" layout.cols="$cols" reach="$reach" instances=z3-7
        instances.min_obstacles="$obstacles" instances.max_obstacles="$obstacles" instances.test_size="$test_size"
        split=test timing=batched threads=1 model="$weights")
    [ "$size" = "$2" ] || world+=(layout.cell_m="${2#*@}")
    # Dense boards would take for ever.
    evaluate "$folder/exact" "${world[@]}" planner='[exact]' planners.exact.max_seconds=0.5
    [ ! "$weights" -nt "$folder/model/config.yaml" ] || rm -rf "$folder/model"
    evaluate "$folder/model" "${world[@]}" planner='[learned,guided]' planners.guided.max_seconds=0.5
}

for size in ${SIZES-6x6 7x7 8x8 9x9 10x10 10x10@0.09}; do
    for percent in ${DENSITIES:-10 20 30 40}; do
        measure wide_hand "$size" "$percent"
    done
done
for reach in ${REACHES-paper_fit panda_slim published jaco panda}; do
    for size in ${REACH_SIZES:-6x6 8x8}; do
        for percent in ${REACH_DENSITIES:-20 30}; do
            measure "$reach" "$size" "$percent"
        done
    done
done
"$bin/python" -m scripts.generalist_page "$out" "$reports/generalist"
"$bin/python" -m scripts.q_maps --model "$weights" --out "$reports/q_values.png"
"$bin/python" -m scripts.failures --model "$weights" --boards "${FAILURE_BOARDS:-5000}" --report "$reports/failures"
