//! Names of views for drawings.

/// The names without what all of them begin and end with: `JAX_068_001_RGB` and `JAX_068_012_RGB` become `001` and `012`.
/// Names that would lose everything stay whole.
#[must_use]
pub fn short_names(names: &[&str]) -> Vec<String> {
    let Some((first, others)) = names.split_first().filter(|(_, others)| !others.is_empty()) else {
        return names.iter().map(|name| (*name).to_owned()).collect();
    };
    let common = |reversed: bool| {
        let letters = |name: &str| -> Vec<char> {
            if reversed { name.chars().rev().collect() } else { name.chars().collect() }
        };
        let first = letters(first);
        let agrees = |n: &usize| others.iter().all(|other| letters(other).get(..*n) == first.get(..*n));
        let longest = (0..=first.len()).rev().find(agrees).unwrap_or(0);
        // A number is not divided: 001 and 012 have no common beginning.
        let whole = first[..longest].iter().rposition(|c| !c.is_alphanumeric()).map_or(0, |at| at + 1);
        if longest == first.len() { 0 } else { whole }
    };
    let (front, back) = (common(false), common(true));
    let short = |name: &&str| {
        let letters: Vec<char> = name.chars().collect();
        let kept = letters.get(front..letters.len().saturating_sub(back)).filter(|kept| !kept.is_empty());
        kept.map_or_else(|| (*name).to_owned(), |kept| kept.iter().collect())
    };
    names.iter().map(short).collect()
}

#[cfg(test)]
mod tests {
    use super::short_names;

    #[test]
    fn what_all_names_share_is_left_out() {
        assert_eq!(short_names(&["JAX_068_001_RGB", "JAX_068_012_RGB"]), ["001", "012"]);
        assert_eq!(short_names(&["VIEW_01", "VIEW_02"]), ["01", "02"]);
        assert_eq!(short_names(&["a", "ab"]), ["a", "ab"]);
        assert_eq!(short_names(&["left", "right"]), ["left", "right"]);
        assert_eq!(short_names(&["alone_1"]), ["alone_1"]);
    }
}
