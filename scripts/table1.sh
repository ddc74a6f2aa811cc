#!/usr/bin/env bash
# docs/results/table1.{csv,md,png}: planning time on 6 x 6, 3 to 9 obstacles, beside the paper's Table 1.
# scripts/tables.sh says how it goes on after a stop, and which variables make it smaller.
cd "$(dirname "$0")/.." && . scripts/tables.sh

out=${OUT:-outputs/table1}
train_models tables/table1 "$out"
evaluate_model "$out/single" exact,graph_search,learned
evaluate_model "$out/sequential" exact,learned,guided
"$bin/python" -m scripts.paper_table 1 "$out" "${REPORT:-docs/results/table1}"
