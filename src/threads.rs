//! Pools of threads: each is made for a caller that asked for it; rayon's global pool is never built.

use crate::math::parallel;
use crate::{Error, Result};
use std::cell::Cell;
use std::sync::OnceLock;

/// Largest number of threads of a pool: limits stacks to 8 GiB of address space.
pub const MAX_THREADS: usize = 1024;

/// Stack of a thread in bytes: that of a main thread on Linux, so that work does as well in a pool as outside.
const STACK: usize = 8 << 20;

thread_local! {
    /// Whether this thread runs a callback: see `in_callback`.
    static IN_CALLBACK: Cell<bool> = const { Cell::new(false) };
}

/// Runs a callback that is called while a pool works for its caller. Calls of the callback into the library run on a separate thread: in
/// the busy pool they would wait. For interfaces to other languages, whose callbacks run on the thread of the caller.
pub fn in_callback<R>(is_callback: bool, run: impl FnOnce() -> R) -> R {
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            IN_CALLBACK.set(self.0);
        }
    }
    let _before = Before(IN_CALLBACK.replace(is_callback));
    run()
}

/// Whether this thread runs a callback.
pub fn is_in_callback() -> bool {
    IN_CALLBACK.get()
}

/// Threads that work is done on: those of the pool that the caller is in already, else of a pool that is built when it is first
/// needed.
pub struct Threads {
    /// 0: one for each core.
    count: usize,
    pool: OnceLock<rayon::ThreadPool>,
}

impl Threads {
    /// `count` threads; 0 for one per core.
    ///
    /// # Errors
    /// [`Error::Argument`] beyond [`MAX_THREADS`].
    pub fn new(count: usize) -> Result<Threads> {
        if count > MAX_THREADS {
            let problem = format!("must lie in 0..{MAX_THREADS}, 0 for all cores");
            return Err(Error::argument("threads", count, problem));
        }
        Ok(Threads { count, pool: OnceLock::new() })
    }

    /// The number that was asked for; 0: one for each core.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Does `work` on the threads.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] if the system refuses the threads.
    pub fn run<R: Send>(&self, work: impl FnOnce() -> R + Send) -> Result<R> {
        if rayon::current_thread_index().is_some() {
            return Ok(work());
        }
        if IN_CALLBACK.get() {
            return Ok(parallel::install(&pool(1)?, work));
        }
        if self.pool.get().is_none() {
            let pool = pool(self.count)?;
            // Another thread may have set a pool meanwhile; either pool serves.
            let _ = self.pool.set(pool);
        }
        Ok(parallel::install(self.pool.get().expect("just set"), work))
    }
}

fn pool(count: usize) -> Result<rayon::ThreadPool> {
    let builder = rayon::ThreadPoolBuilder::new().num_threads(count).stack_size(STACK);
    builder.build().map_err(|e| Error::OutOfMemory(format!("threads cannot be started ({e})")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pool_of_the_caller_goes_first() {
        let two = Threads::new(2).unwrap();
        assert_eq!(two.run(rayon::current_num_threads).unwrap(), 2);
        let three = Threads::new(3).unwrap();
        assert_eq!(two.run(|| three.run(rayon::current_num_threads)).unwrap().unwrap(), 2);
        assert!(Threads::new(MAX_THREADS + 1).is_err());
    }

    /// A pool at work does not hold up what a callback asks of it.
    #[test]
    fn callbacks_have_a_thread_of_their_own() {
        let (one, (tell, told)) = (Threads::new(1).unwrap(), std::sync::mpsc::channel::<()>());
        let told = std::sync::Mutex::new(told);
        std::thread::scope(|scope| {
            scope.spawn(|| one.run(|| told.lock().unwrap().recv().unwrap()).unwrap());
            let asked = in_callback(true, || one.run(rayon::current_num_threads).unwrap());
            assert!(asked == 1 && !is_in_callback());
            tell.send(()).unwrap();
        });
    }
}
