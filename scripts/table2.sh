#!/usr/bin/env bash
# docs/results/table2.{csv,md,png}: rearrangements on 3 x 6, 3 to 9 obstacles, beside the paper's Table 2.
# scripts/tables.sh says how it goes on after a stop, and which variables make it smaller.
cd "$(dirname "$0")/.." && . scripts/tables.sh

out=${OUT:-outputs/table2}
train_models tables/table2 "$out"
# What cannot be solved and is not seen to be would cost transfer learning its whole time: 20 s, and not 60.
evaluate_model "$out/single" exact,straight_line,learned,transfer planners.transfer.max_seconds=20
evaluate_model "$out/sequential" exact,learned,guided
"$bin/python" -m scripts.paper_table 2 "$out" "${REPORT:-docs/results/table2}"
