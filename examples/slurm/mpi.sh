#!/usr/bin/env bash
# One command of mrvis on several nodes by MPI: sbatch --ntasks=8 examples/slurm/mpi.sh batch JOBS.toml --out OUT
# or: sbatch --ntasks=8 examples/slurm/mpi.sh solve SCENE --out DIR. All nodes must see the scene and the output folder.
# MRVIS: a command that was built with `cargo build --release --features mpi`, if it is not in the PATH.
#SBATCH --job-name=mrvis
#SBATCH --cpus-per-task=2
set -euo pipefail
# Open MPI learns nodes and tasks from Slurm; with an Open MPI that knows Slurm's PMIx, `srun --mpi=pmix` does the same.
exec mpirun --map-by "slot:PE=${SLURM_CPUS_PER_TASK:-1}" "${MRVIS:-mrvis}" "$@" --threads "${SLURM_CPUS_PER_TASK:-1}" --mpi
