#!/usr/bin/env bash
# docs/results/vision.md: what the camera reads off random boards with a Kinect's noise, against the truth. Needs a
# Vulkan driver (scripts/install_lavapipe.sh). About five minutes on one core. Settings were chosen on --seed 0.
set -euo pipefail
cd "$(dirname "$0")/.."

export OMP_NUM_THREADS=1
"${BIN:-.venv/bin}/python" -m scripts.measure_vision --report "${REPORT:-docs/results/vision}" "$@"
