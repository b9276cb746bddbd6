//! Where a drawing is cut into tiles.

/// What a tile may be, rad about the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// The widest tile.
    pub widest: f64,
    /// How far two tiles overlap where a contour is cut.
    pub overlap: f64,
    /// The number of tiles; `None` for as few as possible.
    pub count: Option<usize>,
}

/// The border between two tiles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// Its angle about the axis, rad.
    pub at: f64,
    /// Whether it cuts contours; otherwise it is in a gap between them.
    pub is_through_ink: bool,
}

/// How a drawing is divided.
#[derive(Debug, Clone, PartialEq)]
pub struct Tiling {
    /// The borders, in the order of their angles; one fewer than tiles.
    pub cuts: Vec<Cut>,
    /// The smallest and the largest angle of the ink of each tile, rad, with overlaps.
    pub tiles: Vec<[f64; 2]>,
}

/// Number of places at which a cut is tried.
const PLACES: f64 = 1440.0;
const MOST_PLACES: f64 = 6000.0;
/// Maximum number of tiles.
const MOST_TILES: usize = 400;
/// A stretch of angles in which a cut meets the same contours must be wider than this, rad.
const LEAST_ROOM: f64 = 1e-9;

/// A place for a cut.
#[derive(Debug, Clone, Copy)]
struct Place {
    at: f64,
    /// Within these angles a cut meets the same contours, rad.
    room: [f64; 2],
    /// Numbers of cut contours: those that fit into a tile, and those that have to be cut somewhere.
    cuts: [u32; 2],
}

impl Place {
    fn is_through_ink(&self) -> bool {
        self.cuts != [0, 0]
    }

    /// Where the ink after the place begins.
    fn first(&self) -> f64 {
        if self.is_through_ink() { self.at } else { self.room[1] }
    }

    /// Where the ink before the place ends.
    fn last(&self) -> f64 {
        if self.is_through_ink() { self.at } else { self.room[0] }
    }
}

/// What a division costs: the numbers of cut contours, and the sum of the squared widths.
type Cost = ([u32; 2], f64);

fn is_cheaper(one: &Cost, other: &Cost) -> bool {
    one.0.cmp(&other.0).then(one.1.total_cmp(&other.1)).is_lt()
}

/// Divides contours, given by the angles at which they begin and end (rad), into tiles. Contours that fit into a tile are
/// cut as seldom as possible, then there are as few tiles as possible, and they are spread evenly.
///
/// `None` if there are no contours, or no division keeps to the limits.
pub fn plan(spans: &[[f64; 2]], limits: &Limits) -> Option<Tiling> {
    let start = spans.iter().map(|span| span[0]).fold(f64::INFINITY, f64::min);
    let end = spans.iter().map(|span| span[1]).fold(f64::NEG_INFINITY, f64::max);
    let whole = end - start;
    if !whole.is_finite() {
        return None;
    }
    if whole <= limits.widest && limits.count.is_none_or(|count| count == 1) {
        return Some(Tiling { cuts: Vec::new(), tiles: vec![[start, end]] });
    }
    let widest = limits.widest - limits.overlap;
    if widest <= 0.0 {
        return None;
    }
    let places = places(spans, [start, end], widest);
    let most = match limits.count {
        Some(count) => count.min(MOST_TILES),
        None => MOST_TILES.min(2 * (whole / widest).ceil() as usize + 2),
    };
    let chosen = divided(&places, widest, most, limits.count)?;
    Some(tiling(spread(&places, &chosen), limits.overlap))
}

/// Places for cuts in rising order, with the start and the end of the ink.
fn places(spans: &[[f64; 2]], [start, end]: [f64; 2], widest: f64) -> Vec<Place> {
    let mut events: Vec<(f64, [i32; 2])> = Vec::with_capacity(2 * spans.len());
    for [from, to] in spans {
        let fits = to - from <= widest;
        let step = if fits { [1, 0] } else { [0, 1] };
        events.push((*from, step));
        events.push((*to, step.map(|count: i32| -count)));
    }
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = PLACES.max(8.0 * (end - start) / widest).min(MOST_PLACES);
    let size = (end - start) / count;
    let fixed = |at| Place { at, room: [at, at], cuts: [0, 0] };
    let mut places: Vec<Place> = vec![fixed(start)];
    let mut open = [0i32; 2];
    for pair in events.windows(2) {
        open = [open[0] + pair[0].1[0], open[1] + pair[0].1[1]];
        let room = [pair[0].0, pair[1].0];
        if room[1] - room[0] <= LEAST_ROOM {
            continue;
        }
        let cuts = open.map(|count| count.max(0) as u32);
        let cell = |at: f64| ((at - start) / size).floor();
        let (first, last) = (cell(room[0]), cell(room[1]));
        for number in 0..=(last - first) as usize {
            let number = first + number as f64;
            let from = room[0].max(start + number * size);
            let to = room[1].min(start + (number + 1.0) * size);
            if to - from > LEAST_ROOM {
                let place = Place { at: f64::midpoint(from, to), room, cuts };
                keep_best(&mut places, place, |at| cell(at) == number);
            }
        }
    }
    places.push(fixed(end));
    places
}

/// Adds a place, or replaces the last one in the same cell if this one is better: fewer cut contours, or more room.
fn keep_best(places: &mut Vec<Place>, place: Place, is_in_cell: impl Fn(f64) -> bool) {
    let room = |place: &Place| place.room[1] - place.room[0];
    match places.split_first_mut().and_then(|(_, others)| others.last_mut()) {
        Some(last) if is_in_cell(last.at) => {
            if (place.cuts, -room(&place)) < (last.cuts, -room(last)) {
                *last = place;
            }
        }
        _ => places.push(place),
    }
}

/// The indices of the chosen places, without start and end: the cheapest division into at most `most` tiles, or into
/// `exactly` that many.
fn divided(places: &[Place], widest: f64, most: usize, exactly: Option<usize>) -> Option<Vec<usize>> {
    let end = places.len() - 1;
    // For each number of tiles and each place: the cheapest division of the ink before it, and the place before.
    let mut rows: Vec<Vec<Option<(Cost, usize)>>> = Vec::new();
    let mut best: Option<(Cost, usize)> = None;
    for count in 1..=most {
        let before: Option<&Vec<Option<(Cost, usize)>>> = rows.last();
        let mut row: Vec<Option<(Cost, usize)>> = vec![None; places.len()];
        for to in 1..=end {
            for from in (0..to).rev() {
                let width = places[to].last() - places[from].first();
                if width > widest {
                    break;
                }
                let so_far = match before {
                    None => (from == 0).then_some(([0, 0], 0.0)),
                    Some(row) => row[from].map(|(cost, _)| cost),
                };
                let Some((cuts, squares)) = so_far.filter(|_| width >= 0.0) else { continue };
                let cuts = [cuts[0] + places[to].cuts[0], cuts[1] + places[to].cuts[1]];
                let cost = (cuts, squares + width * width);
                if row[to].is_none_or(|(known, _)| is_cheaper(&cost, &known)) {
                    row[to] = Some((cost, from));
                }
            }
        }
        let reached = row[end].map(|(cost, _)| cost);
        rows.push(row);
        let Some(cost) = reached.filter(|_| exactly.is_none_or(|exactly| exactly == count)) else { continue };
        // A contour that fits into a tile is worth another tile, one that does not is not.
        if best.is_none_or(|(known, _)| cost.0[0] < known.0[0]) {
            best = Some((cost, count));
        }
        if cost.0[0] == 0 {
            break;
        }
    }
    let (_, count) = best?;
    let mut chosen = Vec::with_capacity(count);
    let mut at = end;
    for row in rows[..count].iter().rev() {
        at = row[at]?.1;
        chosen.push(at);
    }
    chosen.pop();
    chosen.reverse();
    Some(chosen)
}

/// The chosen places with start and end, moved within their room: to the middle of a gap, and otherwise so that neighbouring
/// tiles become equally wide.
fn spread(places: &[Place], chosen: &[usize]) -> Vec<Place> {
    let ends = [0, places.len() - 1];
    let mut spread: Vec<Place> =
        [&ends[..1], chosen, &ends[1..]].concat().into_iter().map(|index| places[index]).collect();
    let inner = 1..spread.len() - 1;
    for index in inner.clone() {
        if !spread[index].is_through_ink() {
            spread[index].at = f64::midpoint(spread[index].room[0], spread[index].room[1]);
        }
    }
    for _ in 0..20_000 {
        let mut moved = 0.0f64;
        for index in inner.clone() {
            if !spread[index].is_through_ink() {
                continue;
            }
            let middle = f64::midpoint(spread[index - 1].first(), spread[index + 1].last());
            let [from, to] = spread[index].room;
            let edge = ((to - from) / 4.0).min(1e-7);
            let at = middle.clamp(from + edge, to - edge);
            moved = moved.max((at - spread[index].at).abs());
            spread[index].at = at;
        }
        if moved < 1e-13 {
            break;
        }
    }
    spread
}

fn tiling(places: Vec<Place>, overlap: f64) -> Tiling {
    let last = places.len() - 1;
    let cuts = places[1..last]
        .iter()
        .map(|place| Cut { at: place.at, is_through_ink: place.is_through_ink() })
        .collect();
    let beyond = |place: &Place| if place.is_through_ink() { overlap / 2.0 } else { 0.0 };
    let tiles = places
        .windows(2)
        .map(|pair| [pair[0].first() - beyond(&pair[0]), pair[1].last() + beyond(&pair[1])])
        .collect();
    Tiling { cuts, tiles }
}
