//! The most even division of ink into tiles, without regard to contours.

/// Maximum number of tiles.
pub(super) const MOST_TILES: usize = 400;
/// A stretch of angles in which a cut meets the same contours must be wider than this, rad.
pub(super) const LEAST_ROOM: f64 = 1e-9;

/// Where there is ink, as stretches of angles in rising order with gaps between them.
pub(super) fn inked(spans: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted: Vec<[f64; 2]> = spans.iter().copied().filter(|span| span[0] <= span[1]).collect();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut inked: Vec<[f64; 2]> = Vec::new();
    for span in sorted {
        match inked.last_mut().filter(|last| span[0] <= last[1] + LEAST_ROOM) {
            Some(last) => last[1] = last[1].max(span[1]),
            None => inked.push(span),
        }
    }
    inked
}

/// Where tiles begin if each is as wide as it may be, which gives the smallest number of them. Contours are cut anywhere. No
/// more than one tile too many is listed.
pub(super) fn widest_tiles(inked: &[[f64; 2]], widest: f64) -> Vec<f64> {
    let mut starts = Vec::new();
    let mut reached = f64::NEG_INFINITY;
    for [from, to] in inked {
        while reached < to - LEAST_ROOM || reached < *from {
            if starts.len() > MOST_TILES {
                return starts;
            }
            let start = reached.max(*from);
            starts.push(start);
            reached = start + widest;
        }
    }
    starts
}

/// The width of the widest tile in the most even division into `count` tiles, which cuts contours anywhere, with
/// [`LEAST_ROOM`] for rounding.
pub(super) fn most_even(inked: &[[f64; 2]], count: usize) -> f64 {
    let ends = inked.first().zip(inked.last());
    let (mut narrow, mut wide) = (0.0, ends.map_or(0.0, |(first, last)| last[1] - first[0]));
    if widest_tiles(inked, narrow).len() <= count {
        return narrow + LEAST_ROOM;
    }
    for _ in 0..60 {
        let half = f64::midpoint(narrow, wide);
        if widest_tiles(inked, half).len() <= count { wide = half } else { narrow = half }
    }
    wide + LEAST_ROOM
}
