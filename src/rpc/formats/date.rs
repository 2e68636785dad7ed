//! Acquisition times in the formats of vendors.

/// Converts a date in the format `YYYYMMDDHHMMSS` or ISO 8601 to `YYYY-MM-DDThh:mm:ssZ`, or to `YYYY-MM-DD` if it has
/// no time of day; `None` for other formats. A time with an offset, such as `12:05+02:00`, becomes UTC.
#[must_use]
pub fn iso_date(text: &str) -> Option<String> {
    let separators = ['-', ':', 'T', 't', 'Z', 'z', ' ', '/'];
    let text = text.trim();
    if let Some((local, offset_min)) = split_offset(text) {
        return to_utc(&iso_date(local)?, offset_min);
    }
    if text.contains('+') {
        return None;
    }
    // Fractions of a second are dropped, as no stage needs them.
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    if !fraction.chars().all(|c| c.is_ascii_digit() || c.eq_ignore_ascii_case(&'z')) {
        return None;
    }
    let digits: String = whole.chars().filter(|c| !separators.contains(c)).collect();
    if !digits.chars().all(|c| c.is_ascii_digit()) {
        return None;
    }
    let part = |from: usize, to: usize, limits: std::ops::RangeInclusive<u32>| {
        let text = digits.get(from..to)?;
        limits.contains(&text.parse::<u32>().ok()?).then_some(text)
    };
    let date = format!("{}-{}-{}", part(0, 4, 1900..=2200)?, part(4, 6, 1..=12)?, part(6, 8, 1..=31)?);
    match digits.len() {
        8 => Some(date),
        14 => Some(format!(
            "{date}T{}:{}:{}Z",
            part(8, 10, 0..=23)?,
            part(10, 12, 0..=59)?,
            part(12, 14, 0..=60)?
        )),
        _ => None,
    }
}

/// Splits an offset from UTC, such as `+02:00` or `-0730`, off a time of day; minutes.
fn split_offset(text: &str) -> Option<(&str, i64)> {
    let time = text.find(['T', 't', ' '])?;
    let at = time + text.get(time..)?.rfind(['+', '-'])?;
    let (local, offset) = text.split_at(at);
    let digits: String = offset.get(1..)?.chars().filter(|c| *c != ':').collect();
    let is_whole = matches!(digits.len(), 2 | 4) && digits.chars().all(|c| c.is_ascii_digit());
    let part = |from: usize| digits.get(from..from + 2).map_or(Some(0), |part| part.parse::<i64>().ok());
    let (hours, minutes) = (part(0)?, part(2)?);
    let size = 60 * hours + minutes;
    (is_whole && hours < 24 && minutes < 60)
        .then_some((local, if offset.starts_with('-') { -size } else { size }))
}

/// A time as [`iso_date`] has it, of a place whose clocks are ahead of UTC by some minutes, less than a day, in UTC.
fn to_utc(local: &str, offset_min: i64) -> Option<String> {
    let part = |from: usize, to: usize| local.get(from..to)?.parse::<i64>().ok();
    let (mut year, mut month, mut day) = (part(0, 4)?, part(5, 7)?, part(8, 10)?);
    let minute = 60 * part(11, 13)? + part(14, 16)? - offset_min;
    let days = |year: i64, month: i64| match month {
        2 if year % 4 == 0 && (year % 100 != 0 || year % 400 == 0) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    };
    day += minute.div_euclid(24 * 60);
    if day < 1 {
        (year, month) = if month == 1 { (year - 1, 12) } else { (year, month - 1) };
        day = days(year, month);
    } else if day > days(year, month) {
        (year, month) = if month == 12 { (year + 1, 1) } else { (year, month + 1) };
        day = 1;
    }
    let minute = minute.rem_euclid(24 * 60);
    Some(format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{}", minute / 60, minute % 60, local.get(17..)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_with_an_offset_become_utc() {
        for (text, utc) in [
            ("2023-06-21T12:05:00+02:00", Some("2023-06-21T10:05:00Z")),
            ("2023-12-31T20:30:09.5-0730", Some("2024-01-01T04:00:09Z")),
            ("2024-03-01T00:10:00+01", Some("2024-02-29T23:10:00Z")),
            ("2023-06-21 10:05:00+00:00", Some("2023-06-21T10:05:00Z")),
            ("2023-06-21", Some("2023-06-21")),
            ("2023-06-21+02:00", None),
            ("2023-06-21T12:05:00+2", None),
            ("2023-06-21T12:05:00+24:00", None),
        ] {
            assert_eq!(iso_date(text).as_deref(), utc, "{text}");
        }
    }
}
