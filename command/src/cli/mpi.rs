//! `--mpi`: the processes that an MPI launcher (`mpirun`, `srun`) started share one command. Each is a rank; the first, number 0, writes
//! and prints, the others only compute.
//!
//! An error of any rank ends all of them. Each output appears whole or not at all, so that nothing half-written remains.

#[cfg(feature = "mpi")]
mod world;

use super::Command;
use super::args::Common;
#[cfg(feature = "mpi")]
use super::limits::GIB;
use mrvis::internals::ranks::Ranks;
#[cfg(feature = "mpi")]
use mrvis::internals::threads::MAX_THREADS;
use mrvis::{Error, Result};
use std::process::ExitCode;
#[cfg(feature = "mpi")]
pub use world::{Mailbox, Sharing, World};

/// Statistics of the communication between ranks; none without MPI.
#[cfg(not(feature = "mpi"))]
#[derive(Clone, Debug, serde::Serialize)]
pub enum Sharing {}

/// The option of commands that several processes can share.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct MpiArgs {
    /// Share the work among the processes that mpirun or srun started; the first of them writes and prints. In builds with MPI.
    #[arg(long)]
    pub mpi: bool,
}

impl MpiArgs {
    /// The ranks that share the command: one without the option.
    pub fn ranks(self) -> Ranks {
        #[cfg(feature = "mpi")]
        if let Some(world) = self.world() {
            return Ranks::of(std::sync::Arc::new(world));
        }
        Ranks::default()
    }

    /// Whether this process writes and prints.
    pub fn is_first(self) -> bool {
        #[cfg(feature = "mpi")]
        return self.world().is_none_or(World::is_first);
        #[cfg(not(feature = "mpi"))]
        true
    }

    /// Runs `work` on the first rank only.
    ///
    /// # Errors
    /// As `work`.
    pub fn on_first<T: Default>(self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        if self.is_first() { work() } else { Ok(T::default()) }
    }

    /// Number of ranks on this machine.
    pub fn on_machine(self) -> usize {
        #[cfg(feature = "mpi")]
        return self.world().map_or(1, World::on_machine);
        #[cfg(not(feature = "mpi"))]
        1
    }

    /// Threads of this process by default.
    pub fn threads(self) -> usize {
        #[cfg(feature = "mpi")]
        return self.world().map_or_else(super::cores, World::threads);
        #[cfg(not(feature = "mpi"))]
        super::cores()
    }

    /// All ranks, if the option is given.
    #[cfg(feature = "mpi")]
    pub fn world(self) -> Option<World> {
        self.mpi.then(World::present).flatten()
    }

    /// Communication statistics, if there are several ranks.
    pub fn sharing(self) -> Option<Sharing> {
        #[cfg(feature = "mpi")]
        return self.world().map(World::sharing);
        #[cfg(not(feature = "mpi"))]
        None
    }

    /// Adds the communication statistics to the results, if there are several ranks.
    pub fn add_sharing(self, json: &mut serde_json::Value) {
        if let Some(sharing) = self.sharing() {
            json["sharing"] = serde_json::json!(sharing);
        }
    }

    /// Refuses options that make results depend on the time: ranks would decide differently and deadlock.
    ///
    /// # Errors
    /// [`Error::Argument`] if the option is given.
    pub fn refuse(self, option: &str, is_given: bool) -> Result<()> {
        if !(self.mpi && is_given) {
            return Ok(());
        }
        Err(Error::arguments(format!(
            "{option}: not with --mpi, as ranks would end their parts at different places; omit one of them"
        )))
    }
}

/// Joins the other ranks if the command has `--mpi`. Ranks other than the first become silent, and those of one machine share
/// its memory and cores.
///
/// # Errors
/// The program was built without MPI, or MPI does not start.
pub fn start(command: &mut Command, quiet: bool) -> Result<()> {
    match command.shared() {
        None => return Ok(()),
        Some((args, common)) if args.mpi => return join(common),
        Some(_) => {}
    }
    let has_own_part = matches!(command, Command::Batch(args) if args.has_own_part());
    let launched = launched(|name| std::env::var(name).ok());
    if let (Some((0, count)), false) = (launched, quiet || has_own_part) {
        let what = "copies of this command were started, and each does all of the work: share it with --mpi";
        // A closed standard error is ignored.
        super::say(&format!("mrvis: warning: {count} {what}"));
    }
    Ok(())
}

#[cfg(feature = "mpi")]
fn join(common: Option<&mut Common>) -> Result<()> {
    let world = World::join()?;
    let Some(common) = common else { return Ok(()) };
    let usable =
        mrvis::internals::memory::usable().map(|bytes| bytes as f64 / GIB / world.on_machine() as f64);
    common.max_memory = common.max_memory.or(usable);
    let threads = world.threads();
    common.threads = common.threads.or(Some(threads.min(MAX_THREADS) as u16));
    if !world.is_first() {
        (common.quiet, common.json) = (true, None);
    }
    Ok(())
}

#[cfg(not(feature = "mpi"))]
fn join(_: Option<&mut Common>) -> Result<()> {
    Err(Error::Unsupported(
        "--mpi: this program was built without MPI: build it with cargo build --release --features mpi (Debian: apt-get install \
         libopenmpi-dev openmpi-bin), or omit --mpi"
            .into(),
    ))
}

/// Ends all ranks after an error of this one, which has been reported. Returns without MPI.
pub fn end_after_error() {
    #[cfg(feature = "mpi")]
    if let Some(world) = World::present() {
        world.abort(super::FAILED);
    }
}

/// The exit code of this rank once its command has ended well. Waits for all ranks.
pub fn end(code: ExitCode) -> ExitCode {
    #[cfg(feature = "mpi")]
    if let Some(world) = World::present() {
        world.leave();
        // The launcher would end the first rank if another had a code of its own.
        return if world.is_first() { code } else { ExitCode::SUCCESS };
    }
    code
}

/// The sign of this rank in error messages. Ranks other than the first wait a little before: most errors are those of all ranks, and the
/// first one ends them all.
pub fn sign() -> String {
    #[cfg(feature = "mpi")]
    if let Some(world) = World::present().filter(|world| !world.is_first()) {
        std::thread::sleep(std::time::Duration::from_secs(2));
        return format!("rank {}: ", world.number());
    }
    String::new()
}

/// Variables with the number of this process and how many a launcher started: of Open MPI, of MPICH, and of Slurm's `srun`, which sets
/// no others for programs without MPI or with PMIx. Slurm's batch scripts have no number of tasks of a step.
const LAUNCHERS: [[&str; 2]; 3] = [
    ["OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"],
    ["PMI_RANK", "PMI_SIZE"],
    ["SLURM_PROCID", "SLURM_STEP_NUM_TASKS"],
];

/// The number of this process and how many a launcher started, if it is more than one. `variable` reads the environment.
fn launched(variable: impl Fn(&str) -> Option<String>) -> Option<(usize, usize)> {
    let number = |name: &str| variable(name)?.parse::<usize>().ok();
    let of = |[rank, size]: [&str; 2]| Some((number(rank)?, number(size)?));
    LAUNCHERS.into_iter().filter_map(of).find(|(_, count)| *count > 1)
}

impl Command {
    /// The option `--mpi` of commands that have it, with their common options.
    fn shared(&mut self) -> Option<(MpiArgs, Option<&mut Common>)> {
        Some(match self {
            Command::Batch(args) => (args.mpi, None),
            Command::FormFactors(args) => (args.mpi, Some(&mut args.common)),
            Command::Reference(args) => (args.mpi, Some(&mut args.common)),
            Command::Solve(args) => (args.mpi, Some(&mut args.common)),
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(not(feature = "mpi"))]
    fn programs_without_mpi_say_how_to_get_it() {
        use crate::cli::Cli;
        use clap::Parser as _;
        let line = ["mrvis", "solve", "a.obj", "--out", "o", "--mpi"];
        let mut command = Cli::try_parse_from(line).unwrap().command;
        let error = start(&mut command, true).unwrap_err().to_string();
        assert!(error.starts_with("--mpi: ") && error.contains("--features mpi"), "{error}");
    }

    #[test]
    fn what_depends_on_time_is_refused() {
        let several = MpiArgs { mpi: true };
        assert!(several.refuse("--max-seconds", true).unwrap_err().to_string().contains("--max-seconds"));
        assert!(several.refuse("--max-seconds", false).is_ok());
        assert!(MpiArgs::default().refuse("--max-seconds", true).is_ok());
    }

    #[test]
    fn launchers_are_known_by_their_variables() {
        let launched = |set: &[(&str, &str)]| {
            launched(|name| set.iter().find(|(n, _)| *n == name).map(|(_, value)| value.to_string()))
        };
        let alone = ("OMPI_COMM_WORLD_SIZE", "1");
        let srun = [("SLURM_PROCID", "2"), ("SLURM_STEP_NUM_TASKS", "4")];
        assert_eq!(launched(&srun), Some((2, 4)));
        // `mpirun -n 1` in a step of four tasks.
        assert_eq!(launched(&[&[("OMPI_COMM_WORLD_RANK", "0"), alone], &srun[..]].concat()), Some((2, 4)));
        assert_eq!(launched(&[("PMI_RANK", "0"), ("PMI_SIZE", "3")]), Some((0, 3)));
        // A batch script of Slurm for a job of four tasks.
        assert_eq!(launched(&[("SLURM_PROCID", "0"), ("SLURM_NTASKS", "4")]), None);
        assert_eq!(launched(&[]), None);
    }
}
