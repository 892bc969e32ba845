//! `--mpi`: the processes that an MPI launcher (`mpirun`, `srun`) started share one command. Each is a rank; the first, number 0, writes
//! and prints, the others only compute.
//!
//! An error of any rank ends all of them. Each output appears whole or not at all, so that nothing half-written remains.

use super::Command;
use super::args::Common;
use mpi::Threading;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::point_to_point::MatchedReceiveVec;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;
use mrvis::internals::ranks::{Exchange, Ranks};
use mrvis::{Error, Result};
use std::collections::VecDeque;
use std::process::ExitCode;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

#[cfg(feature = "mpi")]
use super::limits::GIB;
#[cfg(feature = "mpi")]
use mrvis::internals::threads::MAX_THREADS;
#[cfg(feature = "mpi")]

/// What the ranks have exchanged: nothing without MPI.
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

    /// Does what only the first rank does.
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

    /// What the ranks have exchanged, if there are several.
    pub fn sharing(self) -> Option<Sharing> {
        #[cfg(feature = "mpi")]
        return self.world().map(World::sharing);
        #[cfg(not(feature = "mpi"))]
        None
    }

    /// Adds what the ranks have exchanged to the results, if there are several.
    pub fn add_sharing(self, json: &mut serde_json::Value) {
        if let Some(sharing) = self.sharing() {
            json["sharing"] = serde_json::json!(sharing);
        }
    }

    /// Refuses options that make results depend on the time: ranks would decide differently, and wait for each other in vain.
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

/// The session with MPI, which ends when it is dropped.
static SESSION: Mutex<Option<Session>> = Mutex::new(None);

struct Session {
    /// Ends MPI when it is dropped.
    _universe: Universe,
    world: World,
    sharing: Sharing,
}

/// What the ranks have exchanged since the beginning.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Sharing {
    /// Number of ranks.
    ranks: usize,
    /// Times that all ranks gathered rows.
    gathers: usize,
    /// Bytes of rows of all ranks together; each rank receives those of the others.
    bytes: u64,
    /// By rank, seconds of processor time before the last gathering, without the time of gathering.
    busy_s: Vec<f64>,
    /// The largest such times between two gatherings, summed up: the time that the slowest ranks determine.
    slowest_s: f64,
    /// Seconds in which rows were sent and received.
    transfer_s: f64,
    /// Processor time after the last gathering.
    #[serde(skip)]
    cpu_s: f64,
}

impl Sharing {
    /// Adds one gathering: by rank, bytes and nanoseconds of processor time before.
    fn add(&mut self, parts: &[[u64; 2]], transfer: Duration) {
        let busy: Vec<f64> = parts.iter().map(|[_, ns]| *ns as f64 * 1e-9).collect();
        self.busy_s.resize(parts.len(), 0.0);
        self.busy_s.iter_mut().zip(&busy).for_each(|(sum, s)| *sum += s);
        self.slowest_s += busy.iter().copied().fold(0.0, f64::max);
        self.bytes += parts.iter().map(|[length, _]| length).sum::<u64>();
        self.transfer_s += transfer.as_secs_f64();
        self.gathers += 1;
        self.cpu_s = cpu_seconds();
    }
}

/// Processor time of this process, seconds; 0 where it is not known.
fn cpu_seconds() -> f64 {
    #[cfg(target_os = "linux")]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    }
    #[cfg(not(target_os = "linux"))]
    0.0
}

/// Number of processors of this machine that are switched on, as Linux lists them: `0-3,8`.
fn online_cores() -> Option<usize> {
    let list = std::fs::read_to_string("/sys/devices/system/cpu/online").ok()?;
    let count = |range: &str| {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        Some(last.parse::<usize>().ok()?.checked_sub(first.parse().ok()?)? + 1)
    };
    list.trim().split(',').map(count).sum()
}

fn session() -> MutexGuard<'static, Option<Session>> {
    SESSION.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Largest number of bytes that ranks gather in one call of MPI, which counts bytes in 31 bits.
const MAX_GATHERED: usize = 1 << 30;
/// Time between two looks at whether all ranks have ended: MPI itself would use up a core by waiting.
const PAUSE: Duration = Duration::from_millis(1);

/// All ranks, as one of them sees them.
#[derive(Clone, Copy)]
pub struct World {
    count: usize,
    own: usize,
    on_machine: usize,
}

impl World {
    /// Starts MPI.
    ///
    /// # Errors
    /// MPI cannot be called from the threads of a pool.
    pub fn join() -> Result<World> {
        let refused =
            || Error::Unsupported("--mpi: MPI does not start, or not for programs with threads".into());
        let (universe, threading) =
            mpi::initialize_with_threading(Threading::Serialized).ok_or_else(refused)?;
        if threading < Threading::Serialized {
            return Err(refused());
        }
        let all = universe.world();
        let on_machine = all.split_shared(0).size() as usize;
        let world = World { count: all.size() as usize, own: all.rank() as usize, on_machine };
        let sharing = Sharing { ranks: world.count, ..Sharing::default() };
        *session() = Some(Session { _universe: universe, world, sharing });
        Ok(world)
    }

    /// The ranks, once they have joined.
    pub fn present() -> Option<World> {
        session().as_ref().map(|session| session.world)
    }

    /// Ends all ranks with this exit code: others may wait for this one.
    pub fn abort(self, code: u8) -> ! {
        communicator().abort(code.into())
    }

    /// The number of this rank.
    pub fn number(self) -> usize {
        self.own
    }

    /// Number of ranks on this machine, which share its memory and its cores.
    pub fn on_machine(self) -> usize {
        self.on_machine
    }

    /// Threads of a rank by default: the cores that the launcher gave it, else an equal part of those of its machine.
    pub fn threads(self) -> usize {
        let (usable, online) = (super::cores(), online_cores());
        if online.is_some_and(|online| usable < online) { usable } else { usable.div_ceil(self.on_machine) }
    }

    /// Whether this is the first rank.
    pub fn is_first(self) -> bool {
        self.own == 0
    }

    /// What the ranks have exchanged.
    pub fn sharing(self) -> Sharing {
        session().as_ref().map(|session| session.sharing.clone()).unwrap_or_default()
    }

    /// Waits for all ranks and ends MPI.
    pub fn leave(self) {
        let mut all_here = communicator().immediate_barrier();
        while let Err(request) = all_here.test() {
            all_here = request;
            std::thread::sleep(PAUSE);
        }
        drop(session().take());
    }
}

/// Messages between single ranks.
pub struct Mailbox {
    arrived: VecDeque<(usize, Vec<u8>)>,
}

impl Mailbox {
    /// No messages yet; MPI has started.
    pub fn new(_: World) -> Mailbox {
        Mailbox { arrived: VecDeque::new() }
    }

    /// Sends a message. Receives others meanwhile: two ranks that send each other long messages would else wait for ever.
    pub fn send(&mut self, to: usize, message: &[u8]) {
        let world = communicator();
        mpi::request::scope(|scope| {
            let mut sending = world.process_at_rank(to as i32).immediate_send(scope, message);
            while let Err(request) = sending.test() {
                sending = request;
                self.arrived.extend(next());
            }
        });
    }

    /// The next message, if one has arrived, with the rank that sent it.
    pub fn receive(&mut self) -> Option<(usize, Vec<u8>)> {
        self.arrived.pop_front().or_else(next)
    }
}

fn next() -> Option<(usize, Vec<u8>)> {
    let (message, status) = communicator().any_process().immediate_matched_probe()?.matched_receive_vec();
    Some((status.source_rank() as usize, message))
}

fn communicator() -> SimpleCommunicator {
    SimpleCommunicator::world()
}

impl Exchange for World {
    fn count(&self) -> usize {
        self.count
    }

    fn own(&self) -> usize {
        self.own
    }

    fn all_gather(&self, own: &[u8]) -> Vec<Vec<u8>> {
        let world = communicator();
        let busy = cpu_seconds() - session().as_ref().map_or(0.0, |session| session.sharing.cpu_s);
        let mut known = vec![[0u64; 2]; self.count];
        world.all_gather_into(&[own.len() as u64, (1e9 * busy) as u64][..], known.as_flattened_mut());
        let start = Instant::now();
        let lengths: Vec<usize> = known.iter().map(|[length, _]| *length as usize).collect();
        let mut parts: Vec<Vec<u8>> = lengths.iter().map(|&length| Vec::with_capacity(length)).collect();
        let longest = lengths.iter().copied().max().unwrap_or(0);
        let piece = MAX_GATHERED / self.count;
        for from in (0..longest).step_by(piece) {
            let of = |length: usize| from.min(length)..(from + piece).min(length);
            let counts: Vec<i32> = lengths.iter().map(|&length| of(length).len() as i32).collect();
            let starts: Vec<i32> =
                counts.iter().scan(0, |end, count| Some(std::mem::replace(end, *end + count))).collect();
            let mut all = vec![0u8; counts.iter().map(|&count| count as usize).sum()];
            let mut partition = PartitionMut::new(&mut all[..], &counts[..], &starts[..]);
            world.all_gather_varcount_into(&own[of(own.len())], &mut partition);
            for ((part, &start), &count) in parts.iter_mut().zip(&starts).zip(&counts) {
                part.extend_from_slice(&all[start as usize..][..count as usize]);
            }
        }
        if let Some(session) = &mut *session() {
            session.sharing.add(&known, start.elapsed());
        }
        parts
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
