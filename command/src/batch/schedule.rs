//! Schedule: selects the next job and its number of threads. Results do not depend on it.

use std::collections::BTreeSet;

/// Properties of a job that the schedule needs.
#[derive(Clone, Debug, Default)]
pub struct Task {
    /// Jobs that must be done before.
    pub needs: Vec<usize>,
    /// Expected work in any unit: larger jobs start first.
    pub work: f64,
    /// Expected memory, bytes.
    pub memory: u64,
    /// Threads that the job asks for; none: as many as are free.
    pub threads: Option<usize>,
    /// Whether it runs alone, as it measures time.
    pub alone: bool,
}

/// Limits of what runs at once.
#[derive(Clone, Copy, Debug)]
pub struct Capacity {
    /// Threads in all.
    pub threads: usize,
    /// Jobs at once.
    pub jobs: usize,
    /// Memory in all, bytes.
    pub memory: u64,
}

/// Jobs that wait and run.
pub struct Schedule {
    tasks: Vec<Task>,
    /// By process that runs jobs.
    capacities: Vec<Capacity>,
    /// Jobs that wait for nothing, the next one last.
    ready: Vec<usize>,
    /// Jobs that wait for others.
    blocked: BTreeSet<usize>,
    done: Vec<bool>,
    running: Vec<Running>,
}

/// A job that runs.
struct Running {
    job: usize,
    threads: usize,
    /// Index of its process.
    process: usize,
}

impl Schedule {
    /// A schedule of the jobs that are not done, on processes with these limits.
    pub fn new(tasks: Vec<Task>, capacities: Vec<Capacity>, done: Vec<bool>, chosen: &[usize]) -> Schedule {
        let blocked = chosen.iter().copied().filter(|&k| !done[k]).collect();
        let mut schedule =
            Schedule { tasks, capacities, ready: Vec::new(), blocked, done, running: Vec::new() };
        schedule.release();
        schedule
    }

    /// Moves jobs to those that are ready.
    fn release(&mut self) {
        let is_free = |&k: &usize| self.tasks[k].needs.iter().all(|&need| self.done[need]);
        let free: Vec<usize> = self.blocked.iter().copied().filter(is_free).collect();
        if free.is_empty() {
            return;
        }
        self.blocked.retain(|k| free.binary_search(k).is_err());
        self.ready.extend(free);
        // Jobs that run alone come last, so that they do not hold up the others.
        let order = |&k: &usize| (!self.tasks[k].alone, self.tasks[k].work);
        self.ready.sort_by(|a, b| {
            let ((a_shared, a_work), (b_shared, b_work)) = (order(a), order(b));
            a_shared.cmp(&b_shared).then(a_work.total_cmp(&b_work)).then(b.cmp(a))
        });
    }

    /// The next job of a process and its number of threads, if one can start there now.
    pub fn start(&mut self, process: usize) -> Option<(usize, usize)> {
        let capacity = self.capacities[process];
        let here = || self.running.iter().filter(|running| running.process == process);
        let used: usize = here().map(|running| running.threads).sum();
        let memory = self.memory_left(process);
        let (idle, all_idle) = (here().next().is_none(), self.running.is_empty());
        let free = capacity.threads.saturating_sub(used);
        let places = capacity.jobs.saturating_sub(here().count());
        let measures = self.running.iter().any(|running| self.tasks[running.job].alone);
        if measures || !idle && (free == 0 || places == 0) {
            return None;
        }
        let waiting = self.ready.len().div_ceil(self.capacities.len());
        let threads = |task: &Task| {
            let share = free / waiting.min(places).max(1);
            match task.threads {
                _ if task.alone => capacity.threads,
                Some(threads) => threads,
                None => share.max(1),
            }
        };
        // A job that needs more than the capacity runs alone.
        let fits = |&k: &usize| {
            let task = &self.tasks[k];
            if task.alone { all_idle } else { idle || threads(task) <= free && task.memory <= memory }
        };
        let at = self.ready.iter().rposition(fits)?;
        let threads = threads(&self.tasks[self.ready[at]]);
        let job = self.ready.remove(at);
        self.running.push(Running { job, threads, process });
        Some((job, threads))
    }

    /// Number of processes.
    pub fn processes(&self) -> usize {
        self.capacities.len()
    }

    /// Memory that the running jobs of a process leave, bytes.
    pub fn memory_left(&self, process: usize) -> u64 {
        let here = self.running.iter().filter(|running| running.process == process);
        let used: u64 = here.map(|running| self.tasks[running.job].memory).sum();
        self.capacities[process].memory.saturating_sub(used)
    }

    /// The job does not run any more; its outputs are not there yet.
    pub fn ended(&mut self, job: usize) {
        self.running.retain(|running| running.job != job);
    }

    /// The outputs of a job are there.
    pub fn done(&mut self, job: usize) {
        self.done[job] = true;
        self.release();
    }

    /// The job waits again.
    pub fn again(&mut self, job: usize) {
        self.blocked.insert(job);
        self.release();
    }

    /// The job failed for good: takes out all that need it, and returns them.
    pub fn failed(&mut self, job: usize) -> Vec<usize> {
        let mut lost = vec![job];
        let mut next = 0;
        while let Some(&gone) = lost.get(next) {
            next += 1;
            lost.extend(self.blocked.iter().copied().filter(|&k| self.tasks[k].needs.contains(&gone)));
            self.blocked.retain(|k| !lost.contains(k));
        }
        lost.split_off(1)
    }

    /// Jobs that wait.
    pub fn waiting(&self) -> impl Iterator<Item = usize> + '_ {
        self.ready.iter().copied().chain(self.blocked.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: Capacity = Capacity { threads: 2, jobs: 8, memory: 100 };

    fn task(work: f64) -> Task {
        Task { work, memory: 10, ..Task::default() }
    }

    fn schedule(tasks: Vec<Task>, capacity: Capacity) -> Schedule {
        let (done, chosen) = (vec![false; tasks.len()], (0..tasks.len()).collect::<Vec<_>>());
        Schedule::new(tasks, vec![capacity], done, &chosen)
    }

    #[test]
    fn many_jobs_have_a_thread_each_and_the_last_all() {
        let mut s = schedule([1.0, 3.0, 2.0].map(task).into(), TWO);
        // The longest first.
        assert_eq!([s.start(0), s.start(0), s.start(0)], [Some((1, 1)), Some((2, 1)), None]);
        s.ended(1);
        s.ended(2);
        assert_eq!([s.start(0), s.start(0)], [Some((0, 2)), None]);
    }

    #[test]
    fn jobs_wait_for_memory_and_what_they_need() {
        let large = Task { memory: 95, ..task(1.0) };
        let after = Task { needs: vec![0], ..task(9.0) };
        let mut s = schedule(vec![task(5.0), large, after], TWO);
        assert_eq!([s.start(0), s.start(0)], [Some((0, 1)), None]);
        s.ended(0);
        assert_eq!(s.start(0), Some((1, 2)), "alone it may start");
        s.done(0);
        s.ended(1);
        assert_eq!(s.start(0), Some((2, 2)));
    }

    #[test]
    fn measurements_of_time_run_alone_and_last() {
        let bench = Task { alone: true, ..task(9.0) };
        let mut s = schedule(vec![bench, task(1.0), task(1.0)], TWO);
        assert_eq!([s.start(0), s.start(0), s.start(0)], [Some((1, 1)), Some((2, 1)), None]);
        s.ended(1);
        assert_eq!(s.start(0), None);
        s.ended(2);
        assert_eq!([s.start(0), s.start(0)], [Some((0, 2)), None]);
    }

    #[test]
    fn processes_share_the_jobs() {
        let tasks = vec![task(3.0), task(2.0), task(1.0), Task { alone: true, ..task(9.0) }];
        let one = Capacity { threads: 1, ..TWO };
        let mut s = Schedule::new(tasks, vec![one, TWO], vec![false; 4], &[0, 1, 2, 3]);
        assert_eq!([s.start(0), s.start(0)], [Some((0, 1)), None]);
        assert_eq!([s.start(1), s.start(1), s.start(1)], [Some((1, 1)), Some((2, 1)), None]);
        s.ended(0);
        assert_eq!(s.start(0), None, "times are measured when all processes are idle");
        s.ended(1);
        s.ended(2);
        assert_eq!(s.start(1), Some((3, 2)));
    }

    #[test]
    fn a_failure_takes_out_what_needs_it() {
        let need = |k| Task { needs: vec![k], ..task(1.0) };
        let mut s = schedule(vec![task(1.0), need(0), need(1), task(0.5)], TWO);
        assert_eq!(s.start(0).expect("starts").0, 0);
        s.ended(0);
        s.again(0);
        assert_eq!(s.start(0).expect("starts again").0, 0);
        s.ended(0);
        assert_eq!(s.failed(0), [1, 2]);
        assert_eq!(s.waiting().collect::<Vec<_>>(), [3]);
    }
}
