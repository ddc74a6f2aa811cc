#!/usr/bin/env bash
# docs/results/table4.{csv,md,png}: both structures of the paper on Table 4's six columns, taken literally; the improved
# agents, each column from scratch; the shipped model on all; each beside the proved optimum on the same instances.
# What is done is skipped, and with more minutes it goes on. scripts/tables.sh and sweeps.sh have the other variables.
#   LITERAL_MINUTES: of each literal run; empty: Table 5's whole budget. IMPROVED_MINUTES: of each improved one (4).
#   SEEDS: of the improved agents. COLUMNS: of the table. TEST_SIZE: instances a column; of 5,100 some 5,080 can be solved.
#   LITERAL, IMPROVED: more overrides of these sweeps, as hydra.launcher.n_jobs=1 or device=cuda.
cd "$(dirname "$0")/.." && . scripts/sweeps.sh

out=${OUT:-outputs/table4}
columns=${COLUMNS:-6x6_z3-5 6x6_z3-8 7x7_z3-5 7x7_z3-10 8x8_z3-5 8x8_z3-13}
test_size=${TEST_SIZE:-5100}
seeds=${SEEDS:-0,1,2}
together=${columns// /,}
choices=hydra.runtime.choices

# A folder's name says what the run is; a run that broke is named by its sweep, and has no cell in the table.
# shellcheck disable=SC2086 # LITERAL and IMPROVED hold several overrides.
sweep "$out/literal" experiment=paper/table4 column="$together" paper=single,sequential \
    hydra.sweep.subdir="\${$choices.paper}_\${$choices.column}" training.max_minutes="${LITERAL_MINUTES:-null}" \
    ${LITERAL:-}
# shellcheck disable=SC2086
sweep "$out/improved" experiment=table4 column="$together" seed="$seeds" \
    hydra.sweep.subdir="seed\${seed}_\${$choices.column}" training.max_minutes="${IMPROVED_MINUTES:-4}" ${IMPROVED:-}

# How soon they come to the paper's 95 %, by the paper's own test: every 1,000 episodes, five batches at S_T end it.
# shellcheck disable=SC2086
sweep "$out/sooner" experiment=table4 column="$together" seed="$seeds" ipt.every_episodes=1000 \
    ipt.target_success=0.95 hydra.sweep.subdir="seed\${seed}_\${$choices.column}" \
    training.max_minutes="${IMPROVED_MINUTES:-4}" ${IMPROVED:-}

weights=dore/weights/generalist.safetensors
for column in $columns; do
    tested=(instances="${column#*_}" instances.test_size="$test_size" split=test timing=batched threads=1)
    world=(layout="${column%_*}" reach=wide_hand)
    # Once for all models: the labels.
    evaluate "$out/test/$column/exact" "${world[@]}" "${tested[@]}" planner='[exact]'
    [ ! "$weights" -nt "$out/test/$column/generalist/config.yaml" ] || rm -rf "$out/test/$column/generalist"
    evaluate "$out/test/$column/generalist" "${world[@]}" "${tested[@]}" planner='[learned,guided]'
    for run in "$out"/literal/*_"$column" "$out"/improved/*_"$column"; do
        [ -f "$run/done.json" ] || continue
        test=$out/test/$column/$(basename "${run%_"$column"}")
        # A run that has gone on since has another model.
        [ ! "$run/model.safetensors" -nt "$test/config.yaml" ] || rm -rf "$test"
        evaluate "$test" model="$run" "${tested[@]}" planner='[learned]'
    done
done
"$bin/python" -m scripts.table4_page "$out" "${REPORT:-docs/results/table4}"
exit "$broken"
