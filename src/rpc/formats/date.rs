//! Acquisition times as vendors write them.

/// `YYYYMMDDHHMMSS` or ISO 8601 as `YYYY-MM-DDThh:mm:ssZ` (as `YYYY-MM-DD` without a time); none if it is
/// neither.
#[must_use]
pub fn iso_date(text: &str) -> Option<String> {
    let separators = ['-', ':', 'T', 't', 'Z', 'z', ' ', '/'];
    // An offset of zero is UTC; of another, the hour is not known here.
    let text = text.trim();
    let text = text.strip_suffix("+00:00").or(text.strip_suffix("-00:00")).unwrap_or(text);
    if text.contains('+') {
        return None;
    }
    // Fractions of a second are cut off: no stage needs them.
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
