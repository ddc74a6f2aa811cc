# What sweeps share; scripts source it. TRAIN: more overrides of all their trainings.
. scripts/tables.sh
broken=0

# sweep FOLDER OVERRIDES...: a job that breaks is named, and the script goes on, to end with an exit code of its own.
sweep() {
    local folder=$1 code=0
    shift
    # shellcheck disable=SC2086 # TRAIN holds several overrides.
    "$bin/dore-train" -m hydra.sweep.dir="$folder" logger=none "$@" ${TRAIN:-} || code=$?
    [ "$code" -ne 130 ] || exit "$code" # Stopped by hand.
    [ "$code" -eq 0 ] || broken=$code
}
