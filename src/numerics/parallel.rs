//! Loops that all threads do together.

use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};

/// What `work` makes of each item, in their order. A thread takes `per_task` items at the least; before each it looks
/// whether to stop.
///
/// # Errors
/// When it is cancelled.
pub fn each<T: Sync, U: Send>(
    items: &[T],
    per_task: usize,
    work: impl Fn(&T) -> U + Send + Sync,
    cancel: &dyn Cancel,
) -> Result<Vec<U>, Cancelled> {
    let items = items.par_iter().with_min_len(per_task);
    items.map(|item| cancel.check().map(|()| work(item))).collect()
}

/// The same of the numbers from 0 to `count`.
///
/// # Errors
/// When it is cancelled.
pub fn each_number<U: Send>(
    count: usize,
    per_task: usize,
    work: impl Fn(usize) -> U + Send + Sync,
    cancel: &dyn Cancel,
) -> Result<Vec<U>, Cancelled> {
    let numbers = (0..count).into_par_iter().with_min_len(per_task);
    numbers.map(|number| cancel.check().map(|()| work(number))).collect()
}

/// Points that one thread takes at a time: with fewer, handing them over takes longer than the work; with more, small
/// sheets are left to one thread.
const POINTS_PER_TASK: usize = 256;

/// The value of each of `0..count`.
///
/// # Errors
/// When it is cancelled.
pub fn of_each<T: Send>(
    count: usize,
    value: impl Fn(usize) -> T + Send + Sync,
    cancel: &dyn Cancel,
) -> Result<Vec<T>, Cancelled> {
    each_number(count, POINTS_PER_TASK, value, cancel)
}

/// The value of each of `0..count`, with room to work in that is made for a thread's task and used for all of its points.
///
/// # Errors
/// When it is cancelled.
pub fn of_each_with<R: Send, T: Send>(
    count: usize,
    room: impl Fn() -> R + Sync + Send,
    value: impl Fn(&mut R, usize) -> T + Sync,
    cancel: &dyn Cancel,
) -> Result<Vec<T>, Cancelled> {
    let checked = |room: &mut R, point: usize| cancel.check().map(|()| value(room, point));
    (0..count).into_par_iter().with_min_len(POINTS_PER_TASK).map_init(room, checked).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    /// Work that is to stop.
    struct Stopped;

    impl Cancel for Stopped {
        fn is_cancelled(&self) -> bool {
            true
        }
    }

    #[test]
    fn results_are_in_the_order_of_the_items() {
        assert_eq!(each(&[3, 1, 2], 1, |n| n * 10, &Never), Ok(vec![30, 10, 20]));
        assert_eq!(each_number(3, 1, |n| n + 1, &Never), Ok(vec![1, 2, 3]));
    }

    #[test]
    fn a_loop_that_is_stopped_has_no_result() {
        assert_eq!(each(&[1], 1, |n| *n, &Stopped), Err(Cancelled));
        assert_eq!(each_number(1, 1, |n| n, &Stopped), Err(Cancelled));
    }

    #[test]
    fn values_come_in_the_order_of_the_points() {
        let squares: Vec<usize> = (0..5000).map(|n| n * n).collect();
        assert_eq!(of_each(5000, |n| n * n, &Never), Ok(squares));
        assert_eq!(of_each(0, |n| n, &Stopped), Ok(Vec::new()));
        assert_eq!(of_each(1, |n| n, &Stopped), Err(Cancelled));
    }
}
