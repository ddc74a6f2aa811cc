# What scripts/table1.sh to table3.sh share; they source it. A training or an evaluation that is done is skipped, one
# that was stopped or killed goes on, so a table's script can be started again until its page is written.
#   BIN: where the commands are. OUT: where the runs go. REPORT: the page, without its ending.
#   TEST_SIZE: instances a column. COLUMNS: numbers of obstacles. TRAIN: more overrides of the trainings.
set -euo pipefail
export OMP_NUM_THREADS=1

bin=${BIN:-.venv/bin}
test_size=${TEST_SIZE:-500}
columns=${COLUMNS:-3 4 5 6 7 8 9}

# train_models EXPERIMENT OUT: the single and the sequential DQN, up to 7 obstacles. The single one gets slots for 9.
train_models() {
    train "$2/single/train" experiment="$1" agent=single agent.n_slots=9
    train "$2/sequential/train" experiment="$1" agent=sequential
}

# train FOLDER OVERRIDES...
train() {
    local folder=$1
    shift
    if [ -f "$folder/done.json" ]; then
        echo "== $folder is trained"
    elif [ -f "$folder/checkpoint.pt" ]; then
        "$bin/dore-train" resume="$folder"
    else
        # Killed before its first checkpoint: there is nothing to go on from.
        [ ! -f "$folder/config.yaml" ] || rm -rf "$folder"
        # shellcheck disable=SC2086 # TRAIN holds several overrides.
        "$bin/dore-train" run_dir="$folder" logger=none "$@" ${TRAIN:-}
    fi
}

# evaluate_model MODEL_FOLDER PLANNERS OVERRIDES...: each column's instances, one at a time, on one thread.
evaluate_model() {
    local model=$1 planners=$2 z
    shift 2
    for z in $columns; do
        evaluate "$model/z$z" model="$model/train" planner="[$planners]" timing=single threads=1 split=test \
            instances=z3-9 instances.min_obstacles="$z" instances.max_obstacles="$z" \
            instances.test_size="$test_size" "$@"
    done
}

# evaluate FOLDER OVERRIDES...
evaluate() {
    local folder=$1
    shift
    if [ -f "$folder/rows.csv" ]; then
        echo "== $folder is evaluated"
    elif [ -f "$folder/config.yaml" ]; then
        echo "== $folder goes on"
        "$bin/dore-evaluate" resume="$folder"
    else
        echo "== $folder"
        "$bin/dore-evaluate" run_dir="$folder" "$@"
    fi
}
