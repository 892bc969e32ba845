//! Numbers and units in pictures.

use crate::image_io::Picture;

/// Width and height of a character, pixels, without the column after it.
const SIZE: [usize; 2] = [5, 7];
/// Pixels of a picture along the side of a character's pixel.
const SCALE: usize = 2;
/// Height of a line of text, pixels.
pub(super) const LINE: usize = SCALE * (SIZE[1] + 2);

/// Rows of a character from the top; the bit of the left column is 16. Blank for characters that are not known.
fn glyph(character: char) -> [u8; SIZE[1]] {
    match character {
        '0' => [14, 17, 19, 21, 25, 17, 14],
        '1' => [4, 12, 4, 4, 4, 4, 14],
        '2' => [14, 17, 1, 2, 4, 8, 31],
        '3' => [31, 2, 4, 2, 1, 17, 14],
        '4' => [2, 6, 10, 18, 31, 2, 2],
        '5' => [31, 16, 30, 1, 1, 17, 14],
        '6' => [6, 8, 16, 30, 17, 17, 14],
        '7' => [31, 1, 2, 4, 8, 8, 8],
        '8' => [14, 17, 17, 14, 17, 17, 14],
        '9' => [14, 17, 17, 15, 1, 2, 12],
        '.' => [0, 0, 0, 0, 0, 12, 12],
        '-' => [0, 0, 0, 31, 0, 0, 0],
        '/' => [0, 1, 2, 4, 8, 16, 0],
        '²' => [12, 18, 4, 8, 30, 0, 0],
        'W' => [17, 17, 17, 21, 21, 21, 10],
        'e' => [0, 0, 14, 17, 31, 16, 14],
        'l' => [12, 4, 4, 4, 4, 4, 14],
        'm' => [0, 0, 26, 21, 21, 17, 17],
        'x' => [0, 0, 17, 10, 4, 10, 17],
        _ => [0; SIZE[1]],
    }
}

/// Width of a text, pixels.
pub(super) fn width(text: &str) -> usize {
    SCALE * (SIZE[0] + 1) * text.chars().count()
}

/// Writes black text with its upper left corner at a pixel; what lies beyond the picture is left out.
pub(super) fn write(picture: &mut Picture, text: &str, [left, top]: [usize; 2]) {
    for (k, character) in text.chars().enumerate() {
        let glyph = glyph(character);
        for (y, x) in (0..SCALE * SIZE[1]).flat_map(|y| (0..SCALE * SIZE[0]).map(move |x| (y, x))) {
            let (column, row) = (left + SCALE * k * (SIZE[0] + 1) + x, top + y);
            let is_set = glyph[y / SCALE] >> (SIZE[0] - 1 - x / SCALE) & 1 != 0;
            if is_set && column < picture.width && row < picture.height {
                picture.pixels[row * picture.width + column] = [0; 3];
            }
        }
    }
}
