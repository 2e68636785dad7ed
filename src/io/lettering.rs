//! Short texts in pictures: a font of nine rows of five pixels, with the characters that pictures need.

use super::RgbImage;

/// Size of a character, pixels of the font.
const COLUMNS: usize = 5;
const ROWS: usize = 9;
/// Size of a pixel of the font in the picture.
const ENLARGED: usize = 2;
/// Distance between the beginnings of characters, pixels.
const PITCH: usize = (COLUMNS + 1) * ENLARGED;
const INK: [u8; 3] = [28, 30, 33];
/// Rows of each character from the top; the highest bit is the left pixel.
#[rustfmt::skip]
const FONT: [(char, [u8; ROWS]); 28] = [
    (' ', [0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b00000]),
    ('0', [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110, 0b00000, 0b00000]),
    ('1', [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110, 0b00000, 0b00000]),
    ('2', [0b01110, 0b10001, 0b00001, 0b00010, 0b00100, 0b01000, 0b11111, 0b00000, 0b00000]),
    ('3', [0b01110, 0b10001, 0b00001, 0b00110, 0b00001, 0b10001, 0b01110, 0b00000, 0b00000]),
    ('4', [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010, 0b00000, 0b00000]),
    ('5', [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110, 0b00000, 0b00000]),
    ('6', [0b00110, 0b01000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110, 0b00000, 0b00000]),
    ('7', [0b11111, 0b00001, 0b00010, 0b00100, 0b00100, 0b00100, 0b00100, 0b00000, 0b00000]),
    ('8', [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110, 0b00000, 0b00000]),
    ('9', [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00010, 0b01100, 0b00000, 0b00000]),
    ('-', [0b00000, 0b00000, 0b00000, 0b01110, 0b00000, 0b00000, 0b00000, 0b00000, 0b00000]),
    ('+', [0b00000, 0b00100, 0b00100, 0b11111, 0b00100, 0b00100, 0b00000, 0b00000, 0b00000]),
    ('c', [0b00000, 0b00000, 0b01110, 0b10000, 0b10000, 0b10001, 0b01110, 0b00000, 0b00000]),
    ('d', [0b00001, 0b00001, 0b01101, 0b10011, 0b10001, 0b10001, 0b01111, 0b00000, 0b00000]),
    ('e', [0b00000, 0b00000, 0b01110, 0b10001, 0b11111, 0b10000, 0b01110, 0b00000, 0b00000]),
    ('g', [0b00000, 0b00000, 0b01111, 0b10001, 0b10001, 0b10001, 0b01111, 0b00001, 0b01110]),
    ('h', [0b10000, 0b10000, 0b10110, 0b11001, 0b10001, 0b10001, 0b10001, 0b00000, 0b00000]),
    ('i', [0b00100, 0b00000, 0b01100, 0b00100, 0b00100, 0b00100, 0b01110, 0b00000, 0b00000]),
    ('k', [0b10000, 0b10000, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b00000, 0b00000]),
    ('l', [0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110, 0b00000, 0b00000]),
    ('m', [0b00000, 0b00000, 0b11010, 0b10101, 0b10101, 0b10101, 0b10101, 0b00000, 0b00000]),
    ('n', [0b00000, 0b00000, 0b10110, 0b11001, 0b10001, 0b10001, 0b10001, 0b00000, 0b00000]),
    ('o', [0b00000, 0b00000, 0b01110, 0b10001, 0b10001, 0b10001, 0b01110, 0b00000, 0b00000]),
    ('r', [0b00000, 0b00000, 0b10110, 0b11001, 0b10000, 0b10000, 0b10000, 0b00000, 0b00000]),
    ('s', [0b00000, 0b00000, 0b01111, 0b10000, 0b01110, 0b00001, 0b11110, 0b00000, 0b00000]),
    ('t', [0b01000, 0b01000, 0b11100, 0b01000, 0b01000, 0b01001, 0b00110, 0b00000, 0b00000]),
    ('w', [0b00000, 0b00000, 0b10001, 0b10001, 0b10101, 0b10101, 0b01010, 0b00000, 0b00000]),
];

impl RgbImage {
    /// Height of a line of text, pixels.
    pub const TEXT_HEIGHT: usize = ROWS * ENLARGED;

    /// Width of a text, pixels.
    #[must_use]
    pub fn text_width(text: &str) -> usize {
        text.chars().count() * PITCH
    }

    /// Writes a text whose first character has its top left corner at a pixel. Characters that the font lacks are left out, as
    /// is what lies outside of the image.
    pub fn write_text(&mut self, (col, row): (usize, usize), text: &str) {
        for (i, c) in text.chars().enumerate() {
            let Some((_, rows)) = FONT.iter().find(|(known, _)| *known == c) else { continue };
            for (y, bits) in rows.iter().enumerate() {
                for x in (0..COLUMNS).filter(|x| bits >> (COLUMNS - 1 - x) & 1 == 1) {
                    let corner = (col + i * PITCH + x * ENLARGED, row + y * ENLARGED);
                    self.fill(corner, (ENLARGED, ENLARGED), INK);
                }
            }
        }
    }

    /// Fills a rectangle from a corner (column, row) with a size (columns, rows), as far as it lies in the image.
    pub fn fill(&mut self, (col, row): (usize, usize), (width, height): (usize, usize), color: [u8; 3]) {
        for y in row..(row + height).min(self.height) {
            for x in col..(col + width).min(self.width) {
                self.set(x, y, color);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_has_its_width_and_ends_at_the_border() {
        let mut image = RgbImage::white(40, 20);
        image.write_text((0, 0), "3 m low");
        let is_dark = |col: usize| (0..20).any(|row| image.at(col, row) == INK);
        assert!(is_dark(0) && !is_dark(PITCH - 1) && !is_dark(PITCH) && is_dark(2 * PITCH));
        assert_eq!(RgbImage::text_width("3 m low"), 7 * PITCH);
    }
}
