//! Traces pixels to outlines: follows the borders between ink and background, and locates each place on them to a small
//! fraction of a pixel.
//!
//! Only the level decides which pixels belong together, so that holes stay holes. The exact position of the border
//! follows from the grey values: a pixel at a smooth edge is as dark as the share of it that is covered. Summing the
//! coverage across an edge gives its exact position, while interpolating between two pixels is off by up to 0.09 of a
//! pixel. After A. Trujillo-Pino, K. Krissian, M. Alemán-Flores, D. Santana-Cedrés, Accurate subpixel edge location
//! based on partial area effect, Image and Vision Computing 31 (2013) 72-90, section 2, but with as many pixels across
//! the edge as the edge is wide. The crates for contours interpolate linearly, and the time of some grows with the
//! square of an outline's length.

use super::super::error::PatternReadError;
use super::decode::Picture;

/// Largest number of pixel sides on all borders together, which limits memory and time.
const MAX_SIDES: usize = 20_000_000;
/// Largest width of an edge on either side of its middle, pixels; wider ones are shades.
const REACH: i64 = 3;
/// Largest distance of an edge from the pixel side where it was found, pixels.
const FARTHEST: f64 = 1.0;
/// Number of sides before and after a side that determine the direction of the border.
const NEIGHBOURS: usize = 4;
/// Borders of fewer sides have no direction; all of their places are kept.
const SMALL: usize = 12;

/// A side of a pixel between ink and background; in walking direction the ink is on its left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Side {
    /// The corner of the pixels where it starts, x to the right and y down.
    pub(super) from: [u32; 2],
    pub(super) along: Along,
}

/// Directions in the picture, y down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Along {
    Right,
    Down,
    Left,
    Up,
}

/// A place on a border.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// In pixels from the upper left corner of the picture, y down.
    pub(super) at: [f64; 2],
    /// Whether grey pixels show its position; otherwise it is known only to half a pixel.
    pub(super) is_smooth: bool,
}

impl Along {
    const ALL: [Self; 4] = [Self::Right, Self::Down, Self::Left, Self::Up];

    /// The step to the next corner.
    pub(super) fn step(self) -> [i64; 2] {
        [[1, 0], [0, 1], [-1, 0], [0, -1]][self as usize]
    }

    fn turned(self, quarters: usize) -> Self {
        Self::ALL[(self as usize + quarters) % 4]
    }

    fn to_left(self) -> Self {
        self.turned(3)
    }

    fn to_right(self) -> Self {
        self.turned(1)
    }

    /// The pixels left and right of a side that starts at the corner `from`.
    fn pixels(self, [x, y]: [i64; 2]) -> ([i64; 2], [i64; 2]) {
        match self {
            Self::Right => ([x, y - 1], [x, y]),
            Self::Down => ([x, y], [x - 1, y]),
            Self::Left => ([x - 1, y], [x - 1, y - 1]),
            Self::Up => ([x - 1, y - 1], [x, y - 1]),
        }
    }
}

/// Follows every border of the pixels with more ink than `level`, from the top of the picture to its bottom, and passes
/// each to `take` as a closed walk of sides.
pub(super) fn borders(
    picture: &Picture,
    level: u16,
    mut take: impl FnMut(&[Side]) -> Result<(), PatternReadError>,
) -> Result<(), PatternReadError> {
    let (width, height) = (picture.width, picture.height);
    // Every border has a side on the upper edge of an inked pixel; one bit per pixel records whether it was walked.
    let mut walked = vec![0u64; (width * height).div_ceil(64)];
    let mut walk = Vec::new();
    let mut total = 0;
    for y in 0..height {
        for x in 0..width {
            let index = y * width + x;
            let is_top = picture.ink[index] > level && (y == 0 || picture.ink[index - width] <= level);
            if !is_top || walked[index / 64] >> (index % 64) & 1 == 1 {
                continue;
            }
            walk.clear();
            let first = Side { from: [x as u32 + 1, y as u32], along: Along::Left };
            let mut side = first;
            loop {
                if side.along == Along::Left {
                    let index = side.from[1] as usize * width + side.from[0] as usize - 1;
                    walked[index / 64] |= 1 << (index % 64);
                }
                walk.push(side);
                if total + walk.len() > MAX_SIDES {
                    return Err(PatternReadError::TooMany {
                        what: "pixel sides between dark and light",
                        limit: MAX_SIDES,
                        entity: None,
                    });
                }
                side = next(picture, level, side);
                if side == first {
                    break;
                }
            }
            total += walk.len();
            take(&walk)?;
        }
    }
    Ok(())
}

/// The side that follows on the same border.
fn next(picture: &Picture, level: u16, side: Side) -> Side {
    let step = side.along.step();
    let corner = [i64::from(side.from[0]) + step[0], i64::from(side.from[1]) + step[1]];
    let ink = |[x, y]: [i64; 2]| picture.ink_at(x, y);
    let (left, right) = side.along.pixels(corner);
    let (left, right) = (ink(left), ink(right));
    let along = match (left > level, right > level) {
        (true, false) => side.along,
        (true, true) => side.along.to_right(),
        (false, false) => side.along.to_left(),
        (false, true) => {
            // Two pixels with ink touch at a corner: they are joined, as in a slanting hairline, unless the mean of the
            // four pixels is background.
            let back = side.along.pixels([i64::from(side.from[0]), i64::from(side.from[1])]);
            let four = u64::from(left) + u64::from(right) + u64::from(ink(back.0)) + u64::from(ink(back.1));
            if four >= 4 * u64::from(level) { side.along.to_right() } else { side.along.to_left() }
        }
    };
    Side { from: corner.map(|value| value as u32), along }
}

/// The places of a border, one for each side that is roughly parallel to the border.
pub(super) fn places(picture: &Picture, level: u16, walk: &[Side]) -> Vec<Place> {
    let count = walk.len();
    let is_flat = |side: &Side| matches!(side.along, Along::Left | Along::Right);
    let all_kept = count < SMALL;
    // Number of horizontal sides among the middle one and its neighbours on both sides.
    let mut flat = (0..2 * NEIGHBOURS).filter(|&index| is_flat(&walk[index % count])).count();
    let mut places = Vec::with_capacity(count);
    for middle in NEIGHBOURS..NEIGHBOURS + count {
        flat += usize::from(is_flat(&walk[(middle + NEIGHBOURS) % count]));
        let side = &walk[middle % count];
        let alike = if is_flat(side) { flat } else { 2 * NEIGHBOURS + 1 - flat };
        // Sides across the border are skipped: the edge runs nearly along their line of pixels, so it is inexact there.
        if all_kept || alike >= NEIGHBOURS {
            places.push(place(picture, level, side));
        }
        flat -= usize::from(is_flat(&walk[(middle - NEIGHBOURS) % count]));
    }
    places
}

/// The position of the edge at a side, on the line through the centres of the two pixels that the side separates.
fn place(picture: &Picture, level: u16, side: &Side) -> Place {
    let from = side.from.map(i64::from);
    let (inner, outer) = side.along.pixels(from);
    let outwards = [outer[0] - inner[0], outer[1] - inner[1]];
    // Pixel 0 is the inner one, pixel 1 the outer one.
    let ink = |pixel: i64| {
        f64::from(picture.ink_at(inner[0] + pixel * outwards[0], inner[1] + pixel * outwards[1]))
    };
    let (mut first, mut last) = (0, 1);
    while first > -REACH && ink(first - 1) > ink(first) {
        first -= 1;
    }
    while last < 1 + REACH && ink(last + 1) < ink(last) {
        last += 1;
    }
    let (full, ground) = (ink(first), ink(last));
    let covered: f64 = (first + 1..last).map(|pixel| (ink(pixel) - ground) / (full - ground)).sum();
    let exact = first as f64 + 0.5 + covered;
    let linear = (ink(0) - f64::from(level)) / (ink(0) - ink(1));
    let offset = if (exact - 0.5).abs() <= FARTHEST { exact } else { linear };
    let at = std::array::from_fn(|axis| inner[axis] as f64 + 0.5 + offset * outwards[axis] as f64);
    Place { at, is_smooth: last - first > 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(rows: &[&str]) -> Picture {
        let ink = rows.iter().flat_map(|row| row.bytes()).map(|byte| match byte {
            b'.' => 0,
            b'#' => Picture::FULL,
            digit => u16::from(digit - b'0') * (Picture::FULL / 10),
        });
        Picture { width: rows[0].len(), height: rows.len(), ink: ink.collect() }
    }

    fn walks(rows: &[&str]) -> Vec<Vec<Side>> {
        let mut walks = Vec::new();
        borders(&picture(rows), Picture::FULL / 2, |walk| {
            walks.push(walk.to_vec());
            Ok(())
        })
        .unwrap();
        walks
    }

    /// Twice the signed area, y up: positive for a walk with its inside on the left.
    fn double_area(walk: &[Side]) -> i64 {
        walk.iter()
            .map(|side| {
                let ([x, y], step) = (side.from.map(i64::from), side.along.step());
                y * step[0] - x * step[1]
            })
            .sum::<i64>()
    }

    #[test]
    fn outlines_run_counter_clockwise_and_holes_clockwise() {
        let ring = walks(&["#####", "#...#", "#.#.#", "#...#", "#####"]);
        let areas: Vec<i64> = ring.iter().map(|walk| double_area(walk) / 2).collect();
        assert_eq!(areas, [25, 1, -9]);
        assert_eq!(ring[0].len(), 20);
    }

    #[test]
    fn pixels_that_touch_at_corners_are_joined_if_their_mean_is_ink() {
        assert_eq!(walks(&["#.", ".#"]).len(), 1);
        assert_eq!(walks(&["9.", ".9"]).len(), 2);
    }

    #[test]
    fn a_partly_covered_pixel_gives_the_position_of_the_edge() {
        // Columns covered to 3/10 and 8/10, on full and on pale ink: the true width is 3.3 and 3.8 pixels.
        for (rows, right) in
            [(["###3.", "###3."], 3.3), (["###8.", "###8."], 3.8), (["6665.", "6665."], 3.0 + 5.0 / 6.0)]
        {
            let picture = picture(&rows);
            for side in &walks(&rows)[0] {
                let found = place(&picture, Picture::FULL / 2, side);
                if side.along == Along::Up {
                    assert!((found.at[0] - right).abs() < 1e-4 && found.is_smooth, "{found:?}");
                } else {
                    assert!(found.at.iter().all(|value| (value * 2.0).fract() == 0.0), "{found:?}");
                }
            }
        }
    }
}
