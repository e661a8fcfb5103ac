//! Loops that all threads do together.

use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};

/// Points of a surface that one thread takes at a time: with fewer, handing them over takes longer than the work; with
/// more, small sheets are left to one thread.
pub const POINTS_PER_TASK: usize = 256;

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

/// The same, with room to work in that is made for a thread's task and used for all of its numbers.
///
/// # Errors
/// When it is cancelled.
pub fn each_number_within<R: Send, U: Send>(
    count: usize,
    per_task: usize,
    room: impl Fn() -> R + Sync + Send,
    work: impl Fn(&mut R, usize) -> U + Sync,
    cancel: &dyn Cancel,
) -> Result<Vec<U>, Cancelled> {
    let checked = |room: &mut R, number: usize| cancel.check().map(|()| work(room, number));
    (0..count).into_par_iter().with_min_len(per_task).map_init(room, checked).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::{Never, Stopped};

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
    fn room_to_work_in_changes_no_result() {
        let squares: Vec<usize> = (0..5000).map(|n| n * n).collect();
        let with_room = |room: &mut Vec<usize>, n: usize| {
            room.push(n);
            n * n
        };
        assert_eq!(each_number_within(5000, 256, Vec::new, with_room, &Never), Ok(squares));
        assert_eq!(each_number_within(0, 1, Vec::new, with_room, &Stopped), Ok(Vec::new()));
        assert_eq!(each_number_within(1, 1, Vec::new, with_room, &Stopped), Err(Cancelled));
    }
}
