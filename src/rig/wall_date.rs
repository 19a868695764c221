//! The wall-clock date, for file names and notes. It is not used to measure time.

/// Returns the current year, month, day, hour, minute and second, UTC.
#[must_use]
#[expect(
    clippy::disallowed_methods,
    reason = "recordings and calibrations are named by the wall-clock date"
)]
pub fn utc_now() -> [u64; 6] {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let seconds = since.map_or(0, |since| since.as_secs());
    let (year, month, day) = civil(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    [year, month, day, hour, minute, second]
}

/// Returns the current time as ISO 8601, e.g. `2026-11-21T12:02:03Z`.
#[must_use]
pub fn iso_now() -> String {
    let [year, month, day, hour, minute, second] = utc_now();
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Returns year, month and day of a day number since 1970-01-01. Counts in eras of 400 years that
/// begin in March, so that the leap day is the last day of its year.
pub(super) const fn civil(days: u64) -> (u64, u64, u64) {
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let march_based = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * march_based + 2) / 5 + 1;
    let month = if march_based < 10 {
        march_based + 3
    } else {
        march_based - 9
    };
    let year = year_of_era + era * 400 + if month <= 2 { 1 } else { 0 };
    (year, month, day)
}
