#!/usr/bin/env bash
# Builds the wheel, installs it without extras in a fresh environment, and plans, trains and evaluates there, outside the
# checkout: the configs and the model must be inside it, and no simulator may be needed. Takes two minutes.
#   BIN: where the checkout's commands are. FRESH=no: half a minute; only the package comes from the wheel, its
#   dependencies are the checkout's.
set -euo pipefail
cd "$(dirname "$0")/.."

bin=$(cd "${BIN:-.venv/bin}" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$bin/python" -m build --wheel --outdir "$work" . >"$work/build.log" 2>&1 || { cat "$work/build.log"; exit 1; }
wheel=$(echo "$work"/dore-*.whl)
held=$("$bin/python" -m zipfile -l "$wheel")
for part in dore/py.typed licenses/LICENSE; do
    [[ $held == *$part* ]] || { echo "check_wheel.sh: $part is not in the wheel" >&2; exit 1; }
done
if [ "${FRESH:-yes}" = no ]; then
    python=$bin/python
    "$python" -m pip install --quiet --no-deps --target "$work/site" "$wheel"
    export PYTHONPATH=$work/site
else
    unset PYTHONPATH
    python=$work/venv/bin/python
    "$bin/python" -m venv "$work/venv"
    "$python" -m pip install --quiet "$wheel"
fi
cd "$work"

# run COMMAND OVERRIDES...: as dore-COMMAND does.
run() {
    local command=$1
    shift
    "$python" -c "from dore.app.cli import $command; $command()" "$@"
}

found=$("$python" -c "import dore; print(dore.__file__)")
[[ $found == "$work"/* ]] || { echo "check_wheel.sh: dore comes from $found, and not from the wheel" >&2; exit 1; }
run train experiment=demo run_dir=run training.max_minutes=0.05 instances.validation_size=1000
run evaluate model=run run_dir=evaluation limit=5
run plan planner=guided out=plan.json
if [ "${FRESH:-yes}" != no ]; then
    code=0
    run execute plan=plan.json 2>message || code=$?
    cat message
    [ "$code" -eq 2 ] && [ "$(wc -l <message)" -eq 1 ] || { echo "check_wheel.sh: no simulator, exit code $code" >&2; exit 1; }
fi
echo "the wheel works outside the checkout; it has $(stat -c %s "$wheel") bytes"
