//! Dates and times of the calendar, in UTC.

/// A second of the calendar, UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Utc {
    pub year: i64,
    pub month: i64,
    pub day: i64,
    pub hour: i64,
    pub minute: i64,
    pub second: i64,
}

const DAY_S: i64 = 86_400;

impl Utc {
    /// Of so many seconds since 1970: the days are counted in eras of 400 years that begin in March, so that the day
    /// that leap years have more is the last one (H. Hinnant, `civil_from_days`).
    pub fn of(unix_s: i64) -> Self {
        const DAYS_TO_1970: i64 = 719_468;
        const ERA_DAYS: i64 = 146_097;
        let days = unix_s.div_euclid(DAY_S) + DAYS_TO_1970;
        let (era, day) = (days.div_euclid(ERA_DAYS), days.rem_euclid(ERA_DAYS));
        let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
        let day_of_year = day - (365 * year + year / 4 - year / 100);
        let march_month = (5 * day_of_year + 2) / 153;
        let month = if march_month < 10 { march_month + 3 } else { march_month - 9 };
        let second = unix_s.rem_euclid(DAY_S);
        Self {
            year: year + era * 400 + i64::from(month <= 2),
            month,
            day: day_of_year - (153 * march_month + 2) / 5 + 1,
            hour: second / 3600,
            minute: second / 60 % 60,
            second: second % 60,
        }
    }

    /// `2026-11-29 20:03 UTC`.
    pub fn told(self) -> String {
        let Self { year, month, day, hour, minute, .. } = self;
        format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02} UTC")
    }

    /// `20261129`.
    pub fn date(self) -> String {
        format!("{:04}{:02}{:02}", self.year, self.month, self.day)
    }

    /// `200304`.
    pub fn time(self) -> String {
        format!("{:02}{:02}{:02}", self.hour, self.minute, self.second)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_are_dates_of_the_calendar() {
        for (unix_s, date, time) in [
            (0, "19700101", "000000"),
            (951_782_399, "20000228", "235959"),
            (951_782_400, "20000229", "000000"),
            (1_709_251_199, "20240229", "235959"),
            (-1, "19691231", "235959"),
            (4_102_444_800, "21000101", "000000"),
        ] {
            let utc = Utc::of(unix_s);
            assert_eq!([utc.date(), utc.time()], [date, time], "{unix_s}");
        }
        assert_eq!(Utc::of(1_709_251_199).told(), "2024-02-29 23:59 UTC");
    }
}
