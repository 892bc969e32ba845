//! Which job starts next, and on how many threads. Results do not depend on it.

use std::collections::BTreeSet;

/// What the schedule knows of a job.
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
    capacity: Capacity,
    /// Jobs that wait for nothing, the next one last.
    ready: Vec<usize>,
    /// Jobs that wait for others.
    blocked: BTreeSet<usize>,
    done: Vec<bool>,
    /// Threads of each running job.
    running: Vec<(usize, usize)>,
}

impl Schedule {
    /// A schedule of the jobs that are not done.
    pub fn new(tasks: Vec<Task>, capacity: Capacity, done: Vec<bool>, chosen: &[usize]) -> Schedule {
        let blocked = chosen.iter().copied().filter(|&k| !done[k]).collect();
        let mut schedule =
            Schedule { tasks, capacity, ready: Vec::new(), blocked, done, running: Vec::new() };
        schedule.release();
        schedule
    }

    /// Moves jobs to those that are ready.
    fn release(&mut self) {
        let free = |&k: &usize| self.tasks[k].needs.iter().all(|&need| self.done[need]);
        let (free, blocked): (Vec<usize>, BTreeSet<usize>) = {
            let free: Vec<usize> = self.blocked.iter().copied().filter(free).collect();
            let still = self.blocked.iter().copied().filter(|k| free.binary_search(k).is_err());
            let still = still.collect();
            (free, still)
        };
        if free.is_empty() {
            return;
        }
        self.blocked = blocked;
        self.ready.extend(free);
        // Jobs that run alone come last, so that they do not hold up the others.
        let order = |&k: &usize| (!self.tasks[k].alone, self.tasks[k].work);
        self.ready.sort_by(|a, b| {
            let ((a_shared, a_work), (b_shared, b_work)) = (order(a), order(b));
            a_shared.cmp(&b_shared).then(a_work.total_cmp(&b_work)).then(b.cmp(a))
        });
    }

    /// The next job and its number of threads, if one can start now.
    pub fn start(&mut self) -> Option<(usize, usize)> {
        let used: usize = self.running.iter().map(|(_, threads)| threads).sum();
        let memory = self.memory_left();
        let idle = self.running.is_empty();
        let free = self.capacity.threads.saturating_sub(used);
        let places = self.capacity.jobs.saturating_sub(self.running.len());
        if !idle && (free == 0 || places == 0 || self.running.iter().any(|&(k, _)| self.tasks[k].alone)) {
            return None;
        }
        let threads = |task: &Task| {
            let share = self.capacity.threads.saturating_sub(used) / self.ready.len().min(places).max(1);
            match task.threads {
                _ if task.alone => self.capacity.threads,
                Some(threads) => threads,
                None => share.max(1),
            }
        };
        // A job that asks for more than there is runs alone.
        let fits = |&k: &usize| {
            let task = &self.tasks[k];
            idle || (!task.alone && threads(task) <= free && task.memory <= memory)
        };
        let at = self.ready.iter().rposition(fits)?;
        let threads = threads(&self.tasks[self.ready[at]]);
        let job = self.ready.remove(at);
        self.running.push((job, threads));
        Some((job, threads))
    }

    /// Memory that running jobs leave, bytes.
    pub fn memory_left(&self) -> u64 {
        let used: u64 = self.running.iter().map(|&(k, _)| self.tasks[k].memory).sum();
        self.capacity.memory.saturating_sub(used)
    }

    /// The job does not run any more; its outputs are not there yet.
    pub fn ended(&mut self, job: usize) {
        self.running.retain(|(k, _)| *k != job);
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
        Schedule::new(tasks, capacity, done, &chosen)
    }

    #[test]
    fn many_jobs_have_a_thread_each_and_the_last_all() {
        let mut s = schedule([1.0, 3.0, 2.0].map(task).into(), TWO);
        // The longest first.
        assert_eq!([s.start(), s.start(), s.start()], [Some((1, 1)), Some((2, 1)), None]);
        s.ended(1);
        s.ended(2);
        assert_eq!([s.start(), s.start()], [Some((0, 2)), None]);
    }

    #[test]
    fn jobs_wait_for_memory_and_what_they_need() {
        let large = Task { memory: 95, ..task(1.0) };
        let after = Task { needs: vec![0], ..task(9.0) };
        let mut s = schedule(vec![task(5.0), large, after], TWO);
        assert_eq!([s.start(), s.start()], [Some((0, 1)), None]);
        s.ended(0);
        assert_eq!(s.start(), Some((1, 2)), "alone it may start");
        s.done(0);
        s.ended(1);
        assert_eq!(s.start(), Some((2, 2)));
    }

    #[test]
    fn measurements_of_time_run_alone_and_last() {
        let bench = Task { alone: true, ..task(9.0) };
        let mut s = schedule(vec![bench, task(1.0), task(1.0)], TWO);
        assert_eq!([s.start(), s.start(), s.start()], [Some((1, 1)), Some((2, 1)), None]);
        s.ended(1);
        assert_eq!(s.start(), None);
        s.ended(2);
        assert_eq!([s.start(), s.start()], [Some((0, 2)), None]);
    }

    #[test]
    fn a_failure_takes_out_what_needs_it() {
        let need = |k| Task { needs: vec![k], ..task(1.0) };
        let mut s = schedule(vec![task(1.0), need(0), need(1), task(0.5)], TWO);
        assert_eq!(s.start().expect("starts").0, 0);
        s.ended(0);
        s.again(0);
        assert_eq!(s.start().expect("starts again").0, 0);
        s.ended(0);
        assert_eq!(s.failed(0), [1, 2]);
        assert_eq!(s.waiting().collect::<Vec<_>>(), [3]);
    }
}
