//! The clock of the wall, which may jump: a wrong time server, a machine that slept. What is decided by times that stand in
//! rows (which leases have run out, what has been kept long enough) waits after a jump until they are true again.

use std::sync::Mutex;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use tokio::time::Instant;

/// How far the clock may go from the time that has passed before that is a jump. It is set by steps of less all the time, and
/// leases are longer.
const JUMP: SignedDuration = SignedDuration::from_secs(5);

/// The clock of the wall beside one that cannot be set.
#[derive(Debug)]
pub(super) struct Clock {
    begun: Instant,
    seen: Mutex<Seen>,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    wall: Timestamp,
    passed: Instant,
    jumped: Option<Instant>,
}

impl Default for Clock {
    fn default() -> Self {
        let begun = Instant::now();
        Self { begun, seen: Mutex::new(Seen { wall: Timestamp::now(), passed: begun, jumped: None }) }
    }
}

impl Clock {
    /// The time, if the clock has not jumped for so long.
    pub fn steady_for(&self, time: Duration) -> Option<Timestamp> {
        let (wall, passed) = (Timestamp::now(), Instant::now());
        let mut seen = self.seen.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(jump) = seen.look(wall, passed) {
            tracing::warn!(seconds = jump.as_secs(), "the clock has jumped: nothing is erased for an hour");
        }
        seen.is_steady_for(time).then_some(wall)
    }

    /// The same, where a clock that jumped before this process began counts too.
    pub fn steady_for_all_for(&self, time: Duration) -> Option<Timestamp> {
        self.steady_for(time).filter(|_| self.begun.elapsed() >= time)
    }
}

impl Seen {
    /// By how much the clock has jumped since the last look, if it has.
    fn look(&mut self, wall: Timestamp, passed: Instant) -> Option<SignedDuration> {
        let should = SignedDuration::try_from(passed.duration_since(self.passed)).unwrap_or(SignedDuration::MAX);
        let jump = wall.duration_since(self.wall) - should;
        (self.wall, self.passed) = (wall, passed);
        let has_jumped = jump.abs() > JUMP;
        if has_jumped {
            self.jumped = Some(passed);
        }
        has_jumped.then_some(jump)
    }

    /// At the time of the last look.
    fn is_steady_for(&self, time: Duration) -> bool {
        self.jumped.is_none_or(|jumped| self.passed.duration_since(jumped) >= time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_jumps_is_not_steady_for_a_while() {
        let (wall, passed) = (Timestamp::now(), Instant::now());
        let mut seen = Seen { wall, passed, jumped: None };
        let mut look = |wall_seconds: i64, seconds: u64| {
            let found =
                seen.look(wall + SignedDuration::from_secs(wall_seconds), passed + Duration::from_secs(seconds));
            (found.map(|jump| jump.as_secs()), seen.is_steady_for(Duration::from_secs(30)))
        };
        assert_eq!(look(10, 10), (None, true));
        assert_eq!(look(13, 11), (None, true), "a step of two seconds is none");
        assert_eq!(look(3_456_014, 12), (Some(3_456_000), false));
        assert_eq!(look(3_456_043, 41), (None, false));
        assert_eq!(look(43, 41), (Some(-3_456_000), false), "and back");
        assert_eq!(look(72, 70), (None, false));
        assert_eq!(look(73, 71), (None, true));
    }
}
