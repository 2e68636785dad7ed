#!/usr/bin/env bash
# examples/engines/slurm.sh RUN [SBATCH_OPTION...]: makes the tiles of RUN/tiles.json on a SLURM cluster: an array of jobs
# that make the tiles, an array that blends them, and the mosaic; each waits for the end of the one before. SBATCH_OPTIONs,
# such as --account or --partition, are those of all three jobs. RUN and the images need the same path on all nodes, satgs
# and jq must be installed there. Tiles that are done are kept, so the same command tries again what failed. Clusters limit
# the size of arrays (`scontrol show config | grep MaxArraySize`).
set -euo pipefail
[ $# -ge 1 ] || { sed -n '2,6s/^# //p' "$0" >&2; exit 2; }
run=$(realpath "$1")
shift
last=$(jq '.tiles | length - 1' "$run/tiles.json")
# A fifth more than is predicted, for what SLURM counts beside the program.
memory=$(jq '[.tiles[].cost.memory_mb] | max * 1.2 | ceil' "$run/tiles.json")
mkdir -p "$run/slurm"
# In single quotes, for any shell.
quoted="'${run//"'"/"'\\''"}'"

# Exit code 1 and ends by a signal (above 128) are worth another try: 2 is wrong input, 75 too little memory or disk on
# this kind of node.
make_tile='for attempt in 1 2 3; do
    satgs tile run RUN --index "$SLURM_ARRAY_TASK_ID" --threads "$SLURM_CPUS_PER_TASK" && exit 0
    code=$?
    [ "$code" = 1 ] || [ "$code" -gt 128 ] || break
done
exit "$code"'

# Tiles that failed are left out; to blend one of them fails, which holds nothing up.
blend_tile='failed=$(satgs tile status RUN --json | jq -r ".tiles[] | select(.state != \"done\") | \"--without \" + .id")
satgs tile blend RUN --index "$SLURM_ARRAY_TASK_ID" $failed'

tiles=$(sbatch --parsable --job-name=satgs-tiles --array="0-$last" --cpus-per-task=2 --mem="${memory}M" \
    --output="$run/slurm/tile-%a.log" "$@" --wrap "${make_tile//RUN/"$quoted"}")
# The options of this job come last and count, so that SBATCH_OPTIONs for tiles, such as --mem, do not change it.
blends=$(sbatch --parsable "$@" --job-name=satgs-blend --array="0-$last" --dependency="afterany:$tiles" --mem=1000M \
    --output="$run/slurm/blend-%a.log" --wrap "${blend_tile//RUN/"$quoted"}")
mosaic=$(sbatch --parsable "$@" --job-name=satgs-mosaic --dependency="afterany:$blends" --mem=2000M \
    --output="$run/slurm/mosaic.log" --wrap "satgs mosaic $quoted")
echo "tiles: job $tiles, blending: job $blends, mosaic: job $mosaic; \`satgs tile status $run\` shows how far they are"
