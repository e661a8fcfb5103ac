//! A value for each of many points, found by all threads, in the order of the points.

use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};

/// Points that one thread takes at a time: with fewer, handing them over takes longer than the work; with more, small
/// sheets are left to one thread.
const POINTS_PER_TASK: usize = 256;

/// The value of each of `0..count`.
///
/// # Errors
/// When it is cancelled.
pub fn of_each<T: Send>(
    count: usize,
    value: impl Fn(usize) -> T + Sync,
    cancel: &dyn Cancel,
) -> Result<Vec<T>, Cancelled> {
    of_each_with(count, || (), |(), point| value(point), cancel)
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

    struct Stop;

    impl Cancel for Stop {
        fn is_cancelled(&self) -> bool {
            true
        }
    }

    #[test]
    fn values_come_in_the_order_of_the_points() {
        let squares: Vec<usize> = (0..5000).map(|n| n * n).collect();
        assert_eq!(of_each(5000, |n| n * n, &Never), Ok(squares));
        assert_eq!(of_each(0, |n| n, &Stop), Ok(Vec::new()));
        assert_eq!(of_each(1, |n| n, &Stop), Err(Cancelled));
    }
}
