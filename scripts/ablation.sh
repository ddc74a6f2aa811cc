#!/usr/bin/env bash
# docs/results/ablation.{csv,md,png}: what the paper leaves open or does otherwise, one key at a time, on 6 x 6 with 3 to
# 8 obstacles, from the improved default and from the literal form. One sweep of short runs, by name in OUT; what is
# done is skipped, and with more minutes it goes on.
#   MINUTES: of each run. SEEDS: of each change. ONLY: changes to make, of those below; empty: all.
cd "$(dirname "$0")/.." && . scripts/sweeps.sh

out=${OUT:-outputs/ablation}
minutes=${MINUTES:-5}
seeds=${SEEDS:-0,1}

# ablate BASE STRUCTURE CHANGE OVERRIDES...: a run a seed. BASE: improved or literal. STRUCTURE: single or sequential.
ablate() {
    local base=$1 structure=$2 change=$3 group=agent
    shift 3
    [ -z "${ONLY:-}" ] || [[ " $ONLY " == *" $change "* ]] || return 0
    [ "$base" = improved ] || group=paper
    sweep "$out" experiment="ablation/$base" "$group=$structure" "$@" seed="$seeds" training.max_minutes="$minutes" \
        hydra.sweep.subdir="${base}_${structure}_${change}_seed\${seed}"
}

for structure in sequential single; do
    ablate improved "$structure" none
    ablate improved "$structure" mask agent.mask_mode=literal
    ablate literal "$structure" none
    ablate literal "$structure" mask agent.mask_mode=legal
done
ablate improved single heads agent.heads=mean
ablate literal single heads agent.heads=mean

ablate improved sequential chain agent.chain=literal
# 10,000, the paper's, is more updates than these minutes allow.
ablate improved sequential target-update target_update=hard target_update.value_network_update_interval=499
ablate improved sequential learning-rate optimizer.lr=0.0025
ablate improved sequential symmetry agent.symmetry=false
ablate improved sequential step-cost env.rewards.unfinished=-0.2
ablate improved sequential double agent.double=false
ablate improved sequential encoding agent.encoding=planes
ablate improved sequential network network=cells
ablate improved sequential averaging training.averaging=null
ablate improved sequential precision training.precision=float32

ablate literal sequential chain agent.chain=natural
ablate literal sequential target-update target_update=soft "~target_update.value_network_update_interval"
ablate literal sequential learning-rate optimizer.lr=0.001
ablate literal sequential symmetry agent.symmetry=true
ablate literal sequential step-cost env.rewards.unfinished=-0.2
ablate literal sequential double agent.double=true

"$bin/python" -m scripts.ablation_page "$out" "${REPORT:-docs/results/ablation}"
exit "$broken"
