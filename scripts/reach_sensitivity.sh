#!/usr/bin/env bash
# docs/results/reach_sensitivity.md: rearrangements of the proved optimum and of the baseline on 3 x 6 and 6 x 6 over
# what the paper does not say (clearance, fan, the baseline's corridor), and how far from its Tables 2 and 3 each is.
# Takes a quarter of an hour on one core; stopped, it goes on from where it was.
set -euo pipefail
cd "$(dirname "$0")/.."

bin=${BIN:-.venv/bin}
out=${OUT:-outputs/reach_sensitivity}
report=${REPORT:-docs/results/reach_sensitivity}
"$bin/python" -m scripts.reach_sensitivity --csv "$out/rows.csv" --report "$report" "$@"
