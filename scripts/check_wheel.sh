#!/usr/bin/env bash
# Builds the wheel and runs it outside the checkout: the configs and the model must be inside it.
set -euo pipefail
cd "$(dirname "$0")/.."

bin=$PWD/.venv/bin
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$bin/python" -m build --wheel --outdir "$work" . >"$work/build.log" 2>&1 || { cat "$work/build.log"; exit 1; }
# Its dependencies are the checkout's; only the package itself is taken from the wheel.
"$bin/python" -m pip install --quiet --no-deps --target "$work/site" "$work"/dore-*.whl
cd "$work"
PYTHONPATH=$work/site "$bin/python" -c "
import dore, pathlib
assert pathlib.Path(dore.__file__).is_relative_to('$work/site'), dore.__file__
from dore.app.cli import train
train()" experiment=demo run_dir="$work/run" training.max_minutes=0.05 instances.validation_size=1000
test -f "$work/run/model.safetensors"
PYTHONPATH=$work/site "$bin/python" -c "from dore.app.cli import plan; plan()" planner=guided out="$work/plan.json" >/dev/null
test -f "$work/plan.json"
echo "the wheel works outside the checkout"
