//! Loops on the threads of the pool that the caller is in; results are in the order of their items. All share one engine that is compiled
//! once, where each parallel iterator of rayon makes some 5,000 lines of LLVM IR.

use rayon::prelude::*;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Tasks per thread: the last ones, which other threads wait for, are short also if some items take long. A task costs some 0.2 µs.
const TASKS_PER_THREAD: usize = 64;

/// What a loop runs over: numbers, or the elements of a slice.
pub trait Items: Sync {
    /// What the loop gets.
    type Item;

    /// The number of items.
    fn number(&self) -> usize;

    /// The item at a place.
    fn item(&self, place: usize) -> Self::Item;

    /// The smallest number of items of a task.
    fn min_of_task(&self) -> usize {
        1
    }
}

impl Items for Range<usize> {
    type Item = usize;

    fn number(&self) -> usize {
        self.len()
    }

    fn item(&self, place: usize) -> usize {
        self.start + place
    }
}

impl Items for Range<u32> {
    type Item = u32;

    fn number(&self) -> usize {
        self.len()
    }

    fn item(&self, place: usize) -> u32 {
        self.start + place as u32
    }
}

impl<'a, T: Sync> Items for &'a [T] {
    type Item = &'a T;

    fn number(&self) -> usize {
        self.len()
    }

    fn item(&self, place: usize) -> &'a T {
        &self[place]
    }
}

impl<'a, T: Sync> Items for &'a Vec<T> {
    type Item = &'a T;

    fn number(&self) -> usize {
        self.len()
    }

    fn item(&self, place: usize) -> &'a T {
        &self[place]
    }
}

/// Chunks of a slice: see [`chunks`].
pub struct Chunks<'a, T>(&'a [T], usize);

impl<'a, T: Sync> Items for Chunks<'a, T> {
    type Item = &'a [T];

    fn number(&self) -> usize {
        self.0.len().div_ceil(self.1)
    }

    fn item(&self, place: usize) -> &'a [T] {
        let first = place * self.1;
        &self.0[first..self.0.len().min(first + self.1)]
    }
}

/// Chunks of `size` elements of a slice; the last one may be shorter.
pub fn chunks<T>(slice: &[T], size: usize) -> Chunks<'_, T> {
    Chunks(slice, size)
}

/// Items of which a task has at least some: see [`at_least`].
pub struct AtLeast<I>(usize, I);

impl<I: Items> Items for AtLeast<I> {
    type Item = I::Item;

    fn number(&self) -> usize {
        self.1.number()
    }

    fn item(&self, place: usize) -> I::Item {
        self.1.item(place)
    }

    fn min_of_task(&self) -> usize {
        self.0
    }
}

/// Items that take so little time that a task should have at least `min` of them.
pub fn at_least<I: Items>(min: usize, items: I) -> AtLeast<I> {
    AtLeast(min, items)
}

/// What `of` makes of each item.
pub fn map<I: Items, T: Send>(items: I, of: impl Fn(I::Item) -> T + Sync) -> Vec<T> {
    in_parts(items.number(), items.min_of_task(), &|range| {
        let mut found = Vec::with_capacity(range.len());
        for place in range {
            found.push(of(items.item(place)));
        }
        found
    })
}

/// The same with something that the items of one task share, such as buffers.
pub fn map_with<I: Items, S, T: Send>(
    items: I,
    new: impl Fn() -> S + Sync,
    of: impl Fn(&mut S, I::Item) -> T + Sync,
) -> Vec<T> {
    in_parts(items.number(), items.min_of_task(), &|range| {
        let (mut shared, mut found) = (new(), Vec::with_capacity(range.len()));
        for place in range {
            found.push(of(&mut shared, items.item(place)));
        }
        found
    })
}

/// All that `of` makes of the items.
pub fn flat_map<I: Items, V: IntoIterator<Item: Send>>(
    items: I,
    of: impl Fn(I::Item) -> V + Sync,
) -> Vec<V::Item> {
    in_parts(items.number(), items.min_of_task(), &|range| {
        let mut found = Vec::new();
        for place in range {
            for one in of(items.item(place)) {
                found.push(one);
            }
        }
        found
    })
}

/// What `of` makes of each item; none, and as soon as possible, if it makes nothing of one.
pub fn some_map<I: Items, T: Send>(items: I, of: impl Fn(I::Item) -> Option<T> + Sync) -> Option<Vec<T>> {
    try_map_with(items, || (), |(), item| of(item).ok_or(())).ok()
}

/// What `of` makes of each item; as soon as possible the error of an item that has one. With something that the items of one task share.
pub fn try_map_with<I: Items, S, T: Send, E: Send>(
    items: I,
    new: impl Fn() -> S + Sync,
    of: impl Fn(&mut S, I::Item) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E> {
    let (failed, error) = (AtomicBool::new(false), Mutex::new(None));
    let found = in_parts(items.number(), items.min_of_task(), &|range| {
        let (mut shared, mut found) = (new(), Vec::with_capacity(range.len()));
        for place in range {
            if failed.load(Relaxed) {
                break;
            }
            match of(&mut shared, items.item(place)) {
                Ok(one) => found.push(one),
                Err(own) => {
                    failed.store(true, Relaxed);
                    *error.lock().expect("nothing panics with it") = Some(own);
                }
            }
        }
        found
    });
    error.into_inner().expect("nothing panics with it").map_or(Ok(found), Err)
}

/// Calls `work` with the place of each element of a slice and the element.
pub fn for_each_mut<T: Send>(slice: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
    for_each_chunk_mut(slice, 1, |place, one| work(place, &mut one[0]));
}

/// Calls `work` with each element of a slice; as soon as possible the error of an element that has one.
pub fn try_for_each_mut<T: Send, E: Send>(
    slice: &mut [T],
    work: impl Fn(&mut T) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let (failed, error) = (AtomicBool::new(false), Mutex::new(None));
    for_each_mut(slice, |_, one| {
        if !failed.load(Relaxed)
            && let Err(own) = work(one)
        {
            failed.store(true, Relaxed);
            *error.lock().expect("nothing panics with it") = Some(own);
        }
    });
    error.into_inner().expect("nothing panics with it").map_or(Ok(()), Err)
}

/// Calls `work` with the number of each chunk of `size` elements of a slice and the chunk; the last one may be shorter.
pub fn for_each_chunk_mut<T: Send>(slice: &mut [T], size: usize, work: impl Fn(usize, &mut [T]) + Sync) {
    for_each_chunk_mut_with(slice, size, || (), |(), k, chunk| work(k, chunk));
}

/// The same with something that the chunks of one task share.
pub fn for_each_chunk_mut_with<T: Send, S>(
    slice: &mut [T],
    size: usize,
    new: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize, &mut [T]) + Sync,
) {
    let chunks = task_size(slice.len().div_ceil(size), 1);
    let tasks: Vec<Mutex<&mut [T]>> = slice.chunks_mut(size * chunks.max(1)).map(Mutex::new).collect();
    run(tasks.len(), &|task| {
        let (mut shared, mut own) = (new(), tasks[task].lock().expect("one task uses it"));
        for (k, chunk) in own.chunks_mut(size).enumerate() {
            work(&mut shared, task * chunks + k, chunk);
        }
    });
}

/// Sorts items by their keys; those with equal keys stay in their order. At most 2³² items: their places are sorted with their keys, as
/// numbers of one type, so that all sorts share the code.
pub fn sort_by_key<T: Clone + Send + Sync>(items: &mut [T], key: impl Fn(&T) -> (u64, u32) + Sync) {
    let mut order = vec![0u128; items.len()];
    for_each_mut(&mut order, |place, own| {
        let (first, second) = key(&items[place]);
        *own = u128::from(first) << 64 | u128::from(second) << 32 | place as u128;
    });
    order.par_sort_unstable();
    let before = items.to_vec();
    for_each_mut(items, |place, item| item.clone_from(&before[order[place] as u32 as usize]));
}

/// The results of both at once.
pub fn join<A: Send, B: Send>(first: impl FnOnce() -> A + Send, second: impl FnOnce() -> B + Send) -> (A, B) {
    let (mut one, mut other) = (Task::new(first), Task::new(second));
    both(&mut || one.run(), &mut || other.run());
    (one.result(), other.result())
}

fn both(first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)) {
    rayon::join(first, second);
}

/// The result of `work` on the threads of a pool.
pub fn install<T: Send>(pool: &rayon::ThreadPool, work: impl FnOnce() -> T + Send) -> T {
    let mut task = Task::new(work);
    run_in(pool, &mut || task.run());
    task.result()
}

fn run_in(pool: &rayon::ThreadPool, work: &mut (dyn FnMut() + Send)) {
    pool.install(work);
}

/// What runs once, behind a reference of a type that all such work shares; then its result.
enum Task<F, T> {
    Waiting(Option<F>),
    Done(T),
}

impl<T, F: FnOnce() -> T> Task<F, T> {
    fn new(work: F) -> Self {
        Task::Waiting(Some(work))
    }

    fn run(&mut self) {
        if let Task::Waiting(work) = self
            && let Some(work) = work.take()
        {
            *self = Task::Done(work());
        }
    }

    fn result(self) -> T {
        match self {
            Task::Done(result) => result,
            Task::Waiting(_) => unreachable!("it has run"),
        }
    }
}

/// What `make` makes of ranges of the numbers below `count`, one after the other.
fn in_parts<T: Send>(count: usize, min: usize, make: &(dyn Fn(Range<usize>) -> Vec<T> + Sync)) -> Vec<T> {
    let size = task_size(count, min);
    if size == count {
        return make(0..count);
    }
    let mut parts: Vec<Mutex<Vec<T>>> = Vec::new();
    parts.resize_with(count.div_ceil(size), Mutex::default);
    run(parts.len(), &|task| {
        let made = make(task * size..count.min((task + 1) * size));
        *parts[task].lock().expect("one task uses it") = made;
    });
    let mut all =
        Vec::with_capacity(parts.iter_mut().map(|part| part.get_mut().map_or(0, |part| part.len())).sum());
    for part in parts {
        all.append(&mut part.into_inner().expect("tasks that panic are not survived"));
    }
    all
}

/// The number of items of a task, all if there is one thread.
fn task_size(count: usize, min: usize) -> usize {
    if count <= min.max(1) {
        return count;
    }
    match rayon::current_num_threads() {
        1 => count,
        threads => count.div_ceil(threads * TASKS_PER_THREAD).max(min),
    }
}

/// Calls `work` with each number below `count`.
fn run(count: usize, work: &(dyn Fn(usize) + Sync)) {
    if count > 1 {
        (0..count).into_par_iter().with_max_len(1).for_each(work);
    } else if count == 1 {
        work(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
    }

    #[test]
    fn results_are_in_order_on_any_number_of_threads() {
        for (threads, count) in
            [1, 2, 3].into_iter().flat_map(|threads| [0, 1, 2, 63, 1000].map(|n| (threads, n)))
        {
            on_threads(threads, || {
                let numbers: Vec<usize> = (0..count).collect();
                assert_eq!(map(0..count, |i| i), numbers);
                assert_eq!(map(7..count as u32 + 7, |i| i as usize - 7), numbers);
                assert_eq!(map(&numbers, |i| *i), numbers);
                assert_eq!(map(at_least(100, &numbers[..]), |i| *i), numbers);
                let sums: Vec<usize> = numbers.chunks(7).map(|chunk| chunk.iter().sum()).collect();
                assert_eq!(map(chunks(&numbers, 7), |chunk| chunk.iter().sum::<usize>()), sums);
                let some: Vec<usize> = (0..count).flat_map(|i| 0..i % 3).collect();
                assert_eq!(flat_map(0..count, |i| 0..i % 3), some);
                let even: Vec<usize> = (0..count).step_by(2).collect();
                assert_eq!(flat_map(0..count, |i| (i % 2 == 0).then_some(i)), even);
                let with = map_with(
                    &numbers,
                    || 0,
                    |calls, i| {
                        *calls += 1;
                        (*calls > 0, *i)
                    },
                );
                assert!(with.iter().all(|(called, _)| *called) && with.iter().map(|(_, i)| *i).eq(0..count));
                assert_eq!(some_map(0..count, Some), Some(numbers));
            });
        }
    }

    #[test]
    fn nothing_is_made_after_a_failure() {
        for threads in [1, 2] {
            let calls = AtomicUsize::new(0);
            let of = |i: usize| {
                calls.fetch_add(1, Relaxed);
                std::thread::sleep(std::time::Duration::from_micros(20));
                (i != 3).then_some(i)
            };
            assert_eq!(on_threads(threads, || some_map(0..10_000usize, of)), None);
            assert!(calls.into_inner() < 5_000);
            let set = |one: &mut i32| (*one != 3).then(|| *one = -1).ok_or("three");
            let mut numbers: Vec<i32> = (0..10_000).collect();
            assert_eq!(on_threads(threads, || try_for_each_mut(&mut numbers, set)), Err("three"));
            assert_eq!((numbers[0], numbers[3]), (-1, 3));
            // One thread goes through them in turn.
            assert!(threads > 1 || numbers[9_999] == 9_999);
            assert_eq!(on_threads(threads, || try_for_each_mut(&mut [1, 2], set)), Ok(()));
        }
    }

    #[test]
    fn sorting_keeps_the_order_of_equal_keys() {
        let mix = |i: u32| i.wrapping_mul(0x9e37_79b9) >> 7;
        let items: Vec<(u64, u32, u32)> =
            (0..20_000).map(|i| (u64::from(mix(i) % 50) << 40, mix(i) % 7, i)).collect();
        let mut expected = items.clone();
        expected.sort_by_key(|item| (item.0, item.1));
        for threads in [1, 2] {
            let mut sorted = items.clone();
            on_threads(threads, || sort_by_key(&mut sorted, |item| (item.0, item.1)));
            assert_eq!(sorted, expected);
        }
    }

    #[test]
    fn both_results_come_back() {
        let both = || join(|| map(0..100usize, |i| i).len(), || String::from("other"));
        assert_eq!(on_threads(1, both), (100, String::from("other")));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        assert_eq!(
            install(&pool, || (both(), rayon::current_num_threads())),
            ((100, String::from("other")), 2)
        );
    }

    #[test]
    fn every_chunk_is_visited_once() {
        for (threads, length) in [1, 2].into_iter().flat_map(|threads| [0, 1, 10, 999].map(|n| (threads, n)))
        {
            on_threads(threads, || {
                let mut numbers = vec![0; length];
                for_each_chunk_mut(&mut numbers, 4, |k, chunk| {
                    chunk.iter_mut().enumerate().for_each(|(i, n)| *n += 4 * k + i);
                });
                assert!(numbers.iter().copied().eq(0..length));
                for_each_mut(&mut numbers, |i, n| *n += i);
                assert!(numbers.iter().copied().eq((0..length).map(|i| 2 * i)));
            });
        }
    }
}
