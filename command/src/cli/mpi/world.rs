//! The ranks of MPI. Each call into MPI is made by one thread at a time: by that of the command, or by the one that hands out jobs.

use mpi::Threading;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::point_to_point::MatchedReceiveVec;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;
use mrvis::internals::ranks::Exchange;
use mrvis::{Error, Result};
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The session with MPI, which ends when it is dropped.
static SESSION: Mutex<Option<Session>> = Mutex::new(None);

struct Session {
    /// Ends MPI when it is dropped.
    _universe: Universe,
    world: World,
    sharing: Sharing,
}

/// Statistics of the communication between ranks since the start.
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
/// Time between two checks whether all ranks have ended: waiting in MPI itself would occupy a core.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// Handle of one rank to all ranks.
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

    /// Threads of a rank by default: the cores that the launcher gave it, else an equal share of those of its machine.
    pub fn threads(self) -> usize {
        let (usable, online) = (super::super::cores(), online_cores());
        if online.is_some_and(|online| usable < online) { usable } else { usable.div_ceil(self.on_machine) }
    }

    /// Whether this is the first rank.
    pub fn is_first(self) -> bool {
        self.own == 0
    }

    /// Statistics of the communication between ranks.
    pub fn sharing(self) -> Sharing {
        session().as_ref().map(|session| session.sharing.clone()).unwrap_or_default()
    }

    /// Waits for all ranks and ends MPI.
    pub fn leave(self) {
        let mut all_here = communicator().immediate_barrier();
        while let Err(request) = all_here.test() {
            all_here = request;
            std::thread::sleep(POLL_INTERVAL);
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
