#!/usr/bin/env bash
# The same without Slurm: N parts at once on one machine with GNU parallel, or on several with --sshlogin and a shared folder.
#   examples/slurm/parallel.sh JOBS.toml OUT N
set -euo pipefail
jobs=$1 out=$2 parts=$3 mrvis=${MRVIS:-mrvis}
seq "$parts" | parallel --will-cite -j "$parts" "$mrvis" batch "$jobs" --out "$out" --shard "{}/$parts" --threads 1 --quiet
"$mrvis" merge "$out"
