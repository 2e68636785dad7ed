//! Acquisition times in the formats of vendors.

/// Converts a date in the format `YYYYMMDDHHMMSS` or ISO 8601 to `YYYY-MM-DDThh:mm:ssZ`, or to `YYYY-MM-DD` if it has
/// no time of day; `None` for other formats, and for times with an offset from UTC.
#[must_use]
pub fn iso_date(text: &str) -> Option<String> {
    let separators = ['-', ':', 'T', 't', 'Z', 'z', ' ', '/'];
    // An offset of zero means UTC.
    let text = text.trim();
    let text = text.strip_suffix("+00:00").or(text.strip_suffix("-00:00")).unwrap_or(text);
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
