#!/usr/bin/env bash
# A job array of Slurm that runs the jobs of one file: sbatch --array=1-8 examples/slurm/array.sh JOBS.toml OUT
# When all have ended: mrvis merge OUT; mrvis report OUT. A task that was ended goes on when the array is submitted again.
# MRVIS: the command, if it is not in the PATH.
#SBATCH --job-name=mrvis
#SBATCH --cpus-per-task=2
#SBATCH --signal=B:INT@60
set -euo pipefail
jobs=$1 out=$2
# `B` and `exec`, so that the signal before the time limit reaches the command, which then keeps all jobs that are done.
exec "${MRVIS:-mrvis}" batch "$jobs" --out "$out" --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" \
  --threads "${SLURM_CPUS_PER_TASK:-1}" ${SLURM_MEM_PER_NODE:+--memory "$(awk "BEGIN { print 0.8 * $SLURM_MEM_PER_NODE / 1024 }")"}
