//! Text and numbers that other programs wrote.

use super::{ReadError, vsi};
use std::path::Path;

/// Reads a text file in any encoding that [`decode_text`] knows.
///
/// # Errors
/// [`ReadError`] if the file cannot be read.
pub fn read_text(path: &Path) -> Result<String, ReadError> {
    Ok(decode_text(&vsi::read(path).map_err(|e| ReadError::new(path, e))?))
}

/// Decodes text: UTF-16 if it begins with a byte-order mark of UTF-16, otherwise UTF-8 with or without a byte-order mark.
/// What is neither is taken for Latin-1, in which every byte is a character.
#[must_use]
pub fn decode_text(bytes: &[u8]) -> String {
    let utf16 = |rest: &[u8], number: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = rest.chunks_exact(2).map(|pair| number([pair[0], pair[1]])).collect();
        String::from_utf16_lossy(&words)
    };
    match bytes {
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] => utf8(rest),
        _ => utf8(bytes),
    }
}

fn utf8(bytes: &[u8]) -> String {
    let latin1 = |_| bytes.iter().map(|byte| char::from(*byte)).collect();
    std::str::from_utf8(bytes).map_or_else(latin1, str::to_owned)
}

/// A number as programs write it: what Rust parses, and the names that the libraries of Microsoft's compilers give to
/// values that are not finite, such as `-nan(ind)` and `1.#INF`.
#[must_use]
pub fn parse_number(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| {
        let (sign, name) = match word.strip_prefix('-') {
            Some(name) => (-1.0, name),
            None => (1.0, word.strip_prefix('+').unwrap_or(word)),
        };
        let name = name.to_ascii_lowercase();
        if let Some(name) = name.strip_prefix("1.#") {
            return Some(if name.starts_with("inf") { sign * f64::INFINITY } else { f64::NAN });
        }
        (name.starts_with("nan(") && name.ends_with(')')).then_some(f64::NAN)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_of_an_editor_is_read() {
        let text = "café 1";
        let utf16: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            [b"\xef\xbb\xbf", text.as_bytes()].concat(),
            [b"\xff\xfe", &utf16[..]].concat(),
            [b"\xfe\xff", &big[..]].concat(),
            b"caf\xe9 1".to_vec(),
        ] {
            assert_eq!(decode_text(&bytes), text, "{bytes:?}");
        }
    }

    #[test]
    fn numbers_of_every_library_are_read() {
        for (word, expected) in [("-1.5e3", -1500.0), ("inf", f64::INFINITY), ("-1.#INF", f64::NEG_INFINITY)]
        {
            assert_eq!(parse_number(word), Some(expected), "{word}");
        }
        for word in ["nan", "-nan", "-nan(ind)", "NaN(snan)", "-1.#IND", "1.#QNAN"] {
            assert!(parse_number(word).is_some_and(f64::is_nan), "{word}");
        }
        for word in ["", "-", "x", "nano", "1.5,", "nan(", "0x1"] {
            assert_eq!(parse_number(word), None, "{word}");
        }
    }
}
