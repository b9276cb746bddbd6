//! The time of day, as people and programs read it, and the uptime, which nobody can set.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// How long the machine has been running. Unlike the time of day, it cannot be set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Uptime {
    /// The start of the machine that it is counted from; empty where the system does not report it.
    pub(crate) boot: String,
    pub(crate) since: Duration,
}

impl Uptime {
    /// The least time that has passed since `earlier`. After a restart of the machine, only the time since that restart
    /// is certain.
    pub(crate) fn passed_since(&self, earlier: &Self) -> Duration {
        let same_start = self.boot == earlier.boot;
        self.since.checked_sub(earlier.since).filter(|_| same_start).unwrap_or(self.since)
    }
}

/// How long the machine has been running; `None` where the system does not report it.
#[cfg(target_os = "linux")]
pub(crate) fn uptime() -> Option<Uptime> {
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?.trim().to_owned();
    // Two numbers: seconds since the start, including sleep, and the idle time.
    let text = std::fs::read_to_string("/proc/uptime").ok()?;
    let seconds: f64 = text.split(' ').next()?.parse().ok()?;
    Some(Uptime { boot, since: Duration::try_from_secs_f64(seconds).ok()? })
}

/// How long the machine has been running; `None` where the system does not report it.
#[cfg(not(target_os = "linux"))]
pub(crate) fn uptime() -> Option<Uptime> {
    let seconds = sysinfo::System::uptime();
    (seconds > 0).then(|| Uptime { boot: String::new(), since: Duration::from_secs(seconds) })
}

/// A moment as `2026-03-01T12:34:56Z`: universal time to the second, in the form of RFC 3339. A time before 1970, as on
/// a machine without a clock, is shown as the first second of 1970.
pub(crate) fn timestamp(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    let (year, month, day) = civil(days);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

/// The current time, in the form of [`timestamp`].
pub(crate) fn now() -> String {
    timestamp(SystemTime::now())
}

/// Year, month and day of a number of days since 1970 in the Gregorian calendar (Howard Hinnant, "chrono-Compatible
/// Low-Level Date Algorithms", 2013, `civil_from_days`): years begin in March, so that the leap day is the last.
fn civil(days: u64) -> (u64, u64, u64) {
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    (year_of_era + era * 400 + u64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passed_time_is_never_overestimated() {
        let at = |boot: &str, seconds| Uptime { boot: boot.into(), since: Duration::from_secs(seconds) };
        for (name, earlier, now, seconds) in [
            ("one start", at("a", 100), at("a", 130), 30),
            ("a restart, which may have been a second later", at("a", 100), at("b", 20), 20),
            ("a restart long ago", at("a", 100), at("b", 5000), 5000),
            ("starts cannot be distinguished", at("", 100), at("", 130), 30),
            ("it can only be a restart", at("", 100), at("", 20), 20),
        ] {
            assert_eq!(now.passed_since(&earlier), Duration::from_secs(seconds), "{name}");
        }
        let (first, second) = (uptime(), uptime());
        assert_eq!(first.is_some(), second.is_some());
        assert!(first.zip(second).is_none_or(|(first, second)| first.boot == second.boot));
    }

    #[test]
    fn timestamps_agree_with_the_calendar() {
        // GNU date: `date -u -d @SECONDS +%FT%TZ`.
        for (seconds, expected) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (1_767_225_600, "2026-01-01T00:00:00Z"),
            (4_102_444_800, "2100-01-01T00:00:00Z"),
        ] {
            assert_eq!(timestamp(UNIX_EPOCH + Duration::from_secs(seconds)), expected);
        }
    }
}
