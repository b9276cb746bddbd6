//! The AutoCAD colour table, to find the entry nearest to a true colour.

use crate::geometry::pattern::Color;

/// The entry of the colour table nearest to a true colour; 1 to 255.
pub(super) fn nearest_index(rgb: [u8; 3]) -> u8 {
    let distance = |index: &u8| {
        let entry = table_entry(*index);
        entry.iter().zip(rgb).map(|(a, b)| (i32::from(*a) - i32::from(b)).pow(2)).sum::<i32>()
    };
    (1..=255).min_by_key(distance).unwrap_or(7)
}

/// Channels from this value on are white.
const WHITE: u8 = 0xf8;

/// Whether a colour is white also on paper; entry 7 of the table is black there.
pub(super) fn is_white(color: Color) -> bool {
    match color {
        Color::Rgb { rgb, .. } => rgb.iter().all(|channel| *channel >= WHITE),
        Color::Aci(index) => index == 255,
        Color::ByLayer => false,
    }
}

/// Red, green and blue of a table entry as AutoCAD shows it on a dark background.
fn table_entry(index: u8) -> [u8; 3] {
    const BASIC: [[u8; 3]; 10] = [
        [0, 0, 0],
        [255, 0, 0],
        [255, 255, 0],
        [0, 255, 0],
        [0, 255, 255],
        [0, 0, 255],
        [255, 0, 255],
        [255, 255, 255],
        [128, 128, 128],
        [192, 192, 192],
    ];
    const GREYS: [u8; 6] = [0, 101, 102, 153, 204, 255];
    // From 10 on: 24 hues 15° apart, each in five shades, each saturated and pale.
    const SHADES: [f64; 5] = [255.0, 165.0, 127.0, 76.0, 38.0];
    match index {
        0..=9 => BASIC[usize::from(index)],
        250.. => [GREYS[usize::from(index - 250)]; 3],
        _ => {
            let hue = f64::from(index / 10 - 1) * 15.0;
            let shade = SHADES[usize::from(index % 10 / 2)];
            let pale = if index % 2 == 1 { 0.5 } else { 0.0 };
            [0.0, 240.0, 120.0].map(|offset| {
                let angle = (hue + offset) % 360.0;
                let full = ((angle - 180.0).abs() / 60.0 - 1.0).clamp(0.0, 1.0);
                (shade * (pale + (1.0 - pale) * full)) as u8
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_those_of_the_published_table() {
        // From ezdxf's table, which follows AutoCAD's.
        for (index, rgb) in [
            (10, [255, 0, 0]),
            (11, [255, 127, 127]),
            (30, [255, 127, 0]),
            (54, [127, 127, 0]),
            (90, [0, 255, 0]),
            (150, [0, 127, 255]),
            (170, [0, 0, 255]),
            (13, [165, 82, 82]),
            (252, [102, 102, 102]),
        ] {
            let entry = table_entry(index);
            let off = entry.iter().zip(rgb).map(|(a, b)| a.abs_diff(b)).max();
            assert!(off <= Some(2), "{index}: {entry:?} is not {rgb:?}");
        }
    }

    #[test]
    fn the_nearest_entry_of_an_entry_has_the_same_colour() {
        for index in 1..=255 {
            let rgb = table_entry(index);
            assert_eq!(table_entry(nearest_index(rgb)), rgb);
        }
    }
}
