#!/usr/bin/env bash
# Makes and resumes the paper's runs as printed, one after the other, for MINUTES on one core at the lowest priority:
#   scripts/literal.sh 150
# Each run is resumed from its checkpoint; one that has ended is skipped. docs/results/literal/NAME.csv and NAME.json say how
# far each is, and `dore-report study=literal` draws docs/results/literal.md from them at any time.
#   LITERAL_HOME: runs and checkpoints, also outside the checkout (outputs/literal). A checkpoint wants the code that wrote
#   it: start this from a clone that stays as it is. RESULTS: the CSV files (docs/results/literal). BIN: the commands.
#   ONLY: a pattern of the names of runs. MORE: further overrides of all runs.
set -euo pipefail
minutes=${1:-}
case $minutes in '' | *[!0-9]*) minutes=0 ;; esac
[ "$minutes" -gt 1 ] || {
    echo "literal: minutes: got '${1:-}', want a whole number of 2 or more; a run is given a minute to end" >&2
    exit 2
}
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1
home=${LITERAL_HOME:-outputs/literal}
results=${RESULTS:-docs/results/literal}
bin=${BIN:-.venv/bin}
end=$(($(date +%s) + 60 * minutes))
margin=60 # seconds that a run is given to write its checkpoint
child="" stopped="" seen="" worst=0

# A stopped run leaves a checkpoint first; Ctrl-C reaches only this script, for the run is in the background.
stop() {
    stopped=yes
    [ -z "$child" ] || kill -TERM "$child" 2>/dev/null || true
}
trap stop INT TERM

# run NAME OVERRIDES...: paper_fit comes nearest to the paper's Tables 2 and 3, which do not state their reach.
run() {
    local name=$1 folder=$home/$1 left code=0
    shift
    # shellcheck disable=SC2254 # ONLY is a pattern.
    case $name in ${ONLY:-*}) seen=yes ;; *) return 0 ;; esac
    left=$((end - $(date +%s) - margin))
    [ -z "$stopped" ] && [ ! -f "$folder/done.json" ] && [ "$left" -gt 0 ] || return 0
    echo "== $name"
    # shellcheck disable=SC2086 # MORE holds several overrides.
    nice -n 19 timeout --signal=TERM --kill-after="$margin" "$left" "$bin/dore-train" \
        reach=paper_fit logger=none existing=continue run_dir="$folder" "$@" ${MORE:-} &
    child=$!
    while kill -0 "$child" 2>/dev/null; do wait "$child" && code=0 || code=$?; done
    child=""
    [ ! -f "$folder/metrics.csv" ] || "$bin/python" -m scripts.literal_rows run="$folder" out="$results/$name"
    case $code in
    0 | 124 | 130) ;;
    *)
        echo "literal: $name ended with exit code $code" >&2
        worst=$code
        ;;
    esac
}

few="6x6_z3-5 7x7_z3-5 8x8_z3-5"
many="6x6_z3-8 7x7_z3-10 8x8_z3-13"
for seed in 0 1 2; do
    for structure in sequential single; do
        for column in $many $few; do
            run "${structure}_${column}_seed$seed" experiment=paper/$structure column="$column" seed=$seed
        done
    done
    # Other readings of what the paper leaves open.
    other=(experiment=paper/sequential column=6x6_z3-8 seed=$seed)
    run "sequential_6x6_z3-8_natural_seed$seed" "${other[@]}" agent.chain=natural
    run "sequential_6x6_z3-8_lr0.00025_seed$seed" "${other[@]}" optimizer.lr=0.00025
    run "sequential_6x6_z3-8_step_seed$seed" "${other[@]}" training.update_after=step
    run "sequential_6x6_z3-8_rmsprop_seed$seed" "${other[@]}" optimizer=rmsprop optimizer.lr=0.00025
    run "sequential_6x6_z3-8_rmsprop_natural_seed$seed" "${other[@]}" optimizer=rmsprop optimizer.lr=0.00025 agent.chain=natural
    # Copies every 10,000 steps instead of updates: an episode, and so an update, has some 4.5 steps.
    run "sequential_6x6_z3-8_copies_in_steps_seed$seed" "${other[@]}" target_update.value_network_update_interval=2199
    run "sequential_6x6_z3-8_wide_hand_seed$seed" "${other[@]}" reach=wide_hand
done
[ -n "$seen" ] || {
    echo "literal: ONLY: '$ONLY' is the name of no run" >&2
    exit 2
}
[ -z "$stopped" ] || exit 130
exit "$worst"
