//! Whether a JPEG file is complete. Decoders fill the missing end of an incomplete one with grey and only warn.

/// Whether the bytes of a JPEG file hold the end of its picture; true for other files.
///
/// Marker segments before the picture are skipped by their lengths, because thumbnails in them have ends of their own. In
/// the data of the picture a byte 0xFF is never followed by that of a marker, and more data may follow the end.
pub(super) fn is_complete(bytes: &[u8]) -> bool {
    const START: u8 = 0xD8;
    const SCAN: u8 = 0xDA;
    const END: u8 = 0xD9;
    if !bytes.starts_with(&[0xFF, START]) {
        return true;
    }
    let mut at = 2;
    while let Some([0xFF, marker, high, low]) = bytes.get(at..at + 4) {
        if *marker == SCAN {
            return bytes[at..].windows(2).any(|pair| pair == [0xFF, END]);
        }
        // Any number of 0xFF may stand before a marker.
        at += if *marker == 0xFF { 1 } else { 2 + usize::from(u16::from_be_bytes([*high, *low])) };
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_end_counts_only_after_the_start_of_the_picture() {
        // A segment of 6 bytes that holds the end of a thumbnail, the start of the scan, data, the end, a trailer.
        let whole = [
            0xFF, 0xD8, 0xFF, 0xE1, 0, 6, 1, 0xFF, 0xD9, 2, 0xFF, 0xDA, 0, 2, 7, 0xFF, 0, 8, 0xFF, 0xD9, 9, 9,
        ];
        assert!(is_complete(&whole) && is_complete(&whole[..20]));
        for length in 2..20 {
            assert!(!is_complete(&whole[..length]), "{length}");
        }
        assert!(is_complete(b"\x89PNG") && is_complete(&[]));
    }
}
