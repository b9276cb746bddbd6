//! Where a drawing is cut into tiles.

use std::ops::RangeInclusive;

use super::even::{LEAST_ROOM, MOST_TILES, inked, most_even, widest_tiles};

/// What a tile may be, rad about the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// The widest tile.
    pub widest: f64,
    /// How far two tiles overlap where a contour is cut.
    pub overlap: f64,
    /// The number of tiles; `None` for as few as possible.
    pub count: Option<usize>,
    /// A given number of tiles does not cut contours into narrower pieces than this.
    pub narrowest: f64,
    /// Tiles up to this width may be twice as wide as others if the number of tiles is given and no contour is cut then that
    /// fits into one.
    pub gentle: f64,
}

impl Limits {
    /// The widest tile without the overlap.
    fn usable(&self) -> f64 {
        self.widest - self.overlap
    }
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
    /// The number of tiles that would be enough for tiles as narrow as these, if contours that fit into a tile are cut only
    /// because more were given.
    pub enough: Option<usize>,
}

/// A cut is tried at this number of places at least.
const PLACES: f64 = 1440.0;
/// A cut is tried at this number of places at most.
const MOST_PLACES: f64 = 6000.0;
/// With a given number of tiles, a tile may be wider than in the most even division by this factor, so that
/// cuts get into gaps. This factor applies to any contour that fits into a tile. The incidence at the borders
/// of the tile grows by about the same factor.
const NEARLY_EVEN: f64 = 1.15;
/// The factor instead of [`NEARLY_EVEN`] for contours that are at most half as wide as the tiles. Then a gap
/// is near every even border.
const WIDER: f64 = 4.0 / 3.0;
/// The factor instead of [`NEARLY_EVEN`] if the tiles are still gentle ([`Limits::gentle`]) and no contour
/// that fits into one tile is cut then.
const WIDER_IF_GENTLE: f64 = 2.0;
/// A tile is a sliver if it ends at a cut contour and is narrower than this share of the widest tile of the
/// most even division. A contour that is too wide for one tile by [`WIDER`] can always be cut into wider
/// pieces.
const SLIVER: f64 = 0.4;

/// Price of a cut through contours that fit into a tile, in squared widths of an even tile. Moving one border from its even
/// position by a quarter of a tile costs the same; a gap is nearer if no contour is wider than half a tile.
const CUT: f64 = 0.125;
/// Price of each contour that a cut goes through, for up to [`MOST_CONTOURS`].
const CONTOUR: f64 = 0.01;
/// Contours above this number have no price of their own: they are equally far from a gap.
const MOST_CONTOURS: u32 = 4;
/// Price of a cut through contours that must be cut somewhere.
const LONG_CUT: f64 = 0.02;

/// A place for a cut.
#[derive(Debug, Clone, Copy)]
struct Place {
    at: f64,
    /// Within these angles a cut meets the same contours, rad.
    room: [f64; 2],
    /// Numbers of cut contours: those that fit into a tile, and those that have to be cut somewhere.
    cuts: [u32; 2],
    /// The same where they matter more than even tiles do.
    first: [u32; 2],
    /// What they cost otherwise, as a squared width.
    price: f64,
}

impl Place {
    fn is_through_ink(&self) -> bool {
        self.cuts != [0, 0]
    }

    /// Where the ink after the place begins.
    fn ink_after(&self) -> f64 {
        if self.is_through_ink() { self.at } else { self.room[1] }
    }

    /// Where the ink before the place ends.
    fn ink_before(&self) -> f64 {
        if self.is_through_ink() { self.at } else { self.room[0] }
    }
}

/// What matters more if tiles become uneven without cut contours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Priority {
    WholeContours,
    EvenTiles,
}

/// What a division costs: the number of slivers, those of cut contours, and the sum of the squared widths and prices.
type Cost = (u32, [u32; 2], f64);

fn is_cheaper(one: &Cost, other: &Cost) -> bool {
    (one.0, one.1).cmp(&(other.0, other.1)).then(one.2.total_cmp(&other.2)).is_lt()
}

/// Divides contours, given by the angles at which they begin and end (rad), into tiles. Contours that fit
/// into a tile are cut as seldom as possible. Then there are as few tiles as possible, and they are spread
/// evenly.
///
/// With a given number of tiles, they are about as wide as in the most even division. Cuts are in gaps if
/// this makes no tile a sliver, and no tile wider than the even ones by more than a third. Gentle tiles may
/// be twice as wide.
///
/// `None` if there are no contours, or if every division exceeds the limits; see [`counts`].
pub fn plan(spans: &[[f64; 2]], limits: &Limits) -> Option<Tiling> {
    let inked = inked(spans);
    let (start, end) = (inked.first()?[0], inked.last()?[1]);
    let whole = end - start;
    if !whole.is_finite() {
        return None;
    }
    if whole <= limits.widest && limits.count.is_none_or(|count| count == 1) {
        return Some(Tiling { cuts: Vec::new(), tiles: vec![[start, end]], enough: None });
    }
    let widest = limits.usable();
    if widest <= 0.0 {
        return None;
    }
    let Some(count) = limits.count else {
        let chosen = as_few_as_possible(spans, &inked, widest)?;
        return Some(tiling(&spread(&chosen), limits.overlap, None));
    };
    if !counts(spans, limits)?.contains(&count) {
        return None;
    }
    let chosen = spread(&as_many_as_given(spans, &inked, limits, count)?);
    let even = most_even(&inked, count);
    let enough = widest_tiles(&inked, even).len();
    let is_vain = enough < count && cut_contours(&chosen, spans, even) > 0;
    Some(tiling(&chosen, limits.overlap, is_vain.then_some(enough)))
}

/// The numbers of tiles into which [`plan`] can divide contours: from those with the widest tiles to those whose pieces of
/// contours are not narrower than the limits allow. `None` if there are no contours, or the overlap leaves no room.
pub fn counts(spans: &[[f64; 2]], limits: &Limits) -> Option<RangeInclusive<usize>> {
    let inked = inked(spans);
    let widest = limits.usable();
    if inked.is_empty() || widest <= 0.0 {
        return None;
    }
    let whole = inked.last()?[1] - inked.first()?[0];
    let least = if whole <= limits.widest { 1 } else { widest_tiles(&inked, widest + LEAST_ROOM).len() };
    // Neighbours of a tile that is narrower than half the overlap would mark each other's ink.
    let narrowest = limits.narrowest.max(2.0 * limits.overlap).min(widest);
    let pieces = |[from, to]: &[f64; 2]| (((to - from + LEAST_ROOM) / narrowest) as usize).max(1);
    let most = inked.iter().map(pieces).fold(0, usize::saturating_add);
    (least <= MOST_TILES).then(|| least..=most.max(least).min(MOST_TILES))
}

/// The chosen places of as few tiles as possible, with start and end.
fn as_few_as_possible(spans: &[[f64; 2]], inked: &[[f64; 2]], widest: f64) -> Option<Vec<Place>> {
    let whole = inked.last()?[1] - inked.first()?[0];
    let most = MOST_TILES.min(2 * (whole / widest).ceil() as usize + 2);
    let (chosen, _) = divided(&places(spans, [widest, widest], &[]), [0.0, widest], most, None)?;
    let count = chosen.len() - 1;
    let narrow = SLIVER * most_even(inked, count);
    if chosen.windows(2).any(|pair| is_sliver(&pair[0], &pair[1], narrow)) {
        // Contours that are cut somewhere anyway are not worth slivers.
        if let Some((others, (slivers, _, _))) =
            evenly(spans, inked, [widest, widest], count, Priority::WholeContours)
            && slivers == 0
            && cut_contours(&others, spans, widest) <= cut_contours(&chosen, spans, widest)
        {
            return Some(others);
        }
    }
    Some(chosen)
}

/// The chosen places of `count` tiles, with start and end.
fn as_many_as_given(
    spans: &[[f64; 2]],
    inked: &[[f64; 2]],
    limits: &Limits,
    count: usize,
) -> Option<Vec<Place>> {
    let even = most_even(inked, count);
    let most = limits.usable().max(even + LEAST_ROOM);
    let wider = |factor: f64| (even * factor).max(limits.narrowest).min(most);
    let [nearly_even, wide] = [NEARLY_EVEN, WIDER].map(wider);
    let gentle = wider(WIDER_IF_GENTLE).min(limits.gentle - limits.overlap);
    let with_whole_contours = |widest: f64| {
        let (chosen, (slivers, cut, _)) =
            evenly(spans, inked, [nearly_even, widest], count, Priority::WholeContours)?;
        (slivers == 0 && cut[0] == 0).then_some(chosen)
    };
    if let Some(chosen) = with_whole_contours(nearly_even) {
        return Some(chosen);
    }
    let (chosen, _) = evenly(spans, inked, [even / 2.0, wide], count, Priority::EvenTiles)?;
    if gentle > wide
        && cut_contours(&chosen, spans, even) > 0
        && let Some(whole) = with_whole_contours(gentle)
    {
        return Some(whole);
    }
    Some(chosen)
}

/// The number of cut contours up to the width `fits`.
fn cut_contours(chosen: &[Place], spans: &[[f64; 2]], fits: f64) -> usize {
    let is_cut = |[from, to]: &[f64; 2]| chosen.iter().any(|place| *from < place.at && place.at < *to);
    spans.iter().filter(|span| span[1] - span[0] <= fits + LEAST_ROOM && is_cut(span)).count()
}

/// The chosen places of `count` tiles without slivers, with start and end, and what they cost. Contours up to the width
/// `fits` are cut as seldom as possible, or as far as even tiles allow; a cut through several wider ones is as good as one
/// through a single one.
fn evenly(
    spans: &[[f64; 2]],
    inked: &[[f64; 2]],
    [fits, widest]: [f64; 2],
    count: usize,
    priority: Priority,
) -> Option<(Vec<Place>, Cost)> {
    let even = most_even(inked, count);
    let mut places = places(spans, [fits, widest], &widest_tiles(inked, even));
    for place in &mut places {
        place.first = [if priority == Priority::WholeContours { place.cuts[0] } else { 0 }, 0];
        let price = match place.cuts {
            [0, 0] => 0.0,
            [0, _] => LONG_CUT,
            [fitting, _] => CUT + CONTOUR * f64::from(fitting.min(MOST_CONTOURS)),
        };
        place.price = price * even * even;
    }
    divided(&places, [SLIVER * even, widest], count, Some(count))
}

/// Whether the tile between two places ends at a cut contour and is narrower than `narrow`, rad. A narrow tile between gaps
/// has whole contours, which are as narrow in the drawing.
fn is_sliver(from: &Place, to: &Place, narrow: f64) -> bool {
    to.ink_before() - from.ink_after() < narrow && (from.is_through_ink() || to.is_through_ink())
}

/// Places for cuts in rising order, with the start and the end of the ink, for tiles up to the width `widest` and whole
/// contours up to the width `fits`; also those at `wanted` angles in rising order, where contours are there.
fn places(spans: &[[f64; 2]], [fits, widest]: [f64; 2], wanted: &[f64]) -> Vec<Place> {
    let start = spans.iter().map(|span| span[0]).fold(f64::INFINITY, f64::min);
    let end = spans.iter().map(|span| span[1]).fold(f64::NEG_INFINITY, f64::max);
    let mut events: Vec<(f64, [i32; 2])> = Vec::with_capacity(2 * spans.len());
    for [from, to] in spans {
        let step = if to - from <= fits { [1, 0] } else { [0, 1] };
        events.push((*from, step));
        events.push((*to, step.map(|count: i32| -count)));
    }
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = PLACES.max(8.0 * (end - start) / widest).min(MOST_PLACES);
    let size = (end - start) / count;
    let fixed = |at| Place { at, room: [at, at], cuts: [0, 0], first: [0, 0], price: 0.0 };
    let mut places: Vec<Place> = vec![fixed(start)];
    let mut exact: Vec<Place> = Vec::new();
    let mut open = [0i32; 2];
    for pair in events.windows(2) {
        open = [open[0] + pair[0].1[0], open[1] + pair[0].1[1]];
        let room = [pair[0].0, pair[1].0];
        if room[1] - room[0] <= LEAST_ROOM {
            continue;
        }
        let cuts = open.map(|count| count.max(0) as u32);
        if cuts != [0, 0] {
            let from = wanted.partition_point(|at| *at <= room[0] + LEAST_ROOM);
            let inside = wanted[from..].iter().take_while(|at| **at < room[1] - LEAST_ROOM);
            exact.extend(inside.map(|at| Place { at: *at, room, cuts, first: cuts, price: 0.0 }));
        }
        let cell = |at: f64| ((at - start) / size).floor();
        let (first, last) = (cell(room[0]), cell(room[1]));
        for number in 0..=(last - first) as usize {
            let number = first + number as f64;
            let from = room[0].max(start + number * size);
            let to = room[1].min(start + (number + 1.0) * size);
            if to - from > LEAST_ROOM {
                let place = Place { at: f64::midpoint(from, to), room, cuts, first: cuts, price: 0.0 };
                keep_best(&mut places, place, |at| cell(at) == number);
            }
        }
    }
    places.push(fixed(end));
    if !exact.is_empty() {
        places.extend(exact);
        places.sort_by(|a, b| a.at.total_cmp(&b.at));
    }
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

/// The chosen places, with start and end: the cheapest division into at most `most` tiles, or into `exactly` that many, and
/// what it costs. Narrower tiles than `narrow` at cut contours are slivers.
fn divided(
    places: &[Place],
    [narrow, widest]: [f64; 2],
    most: usize,
    exactly: Option<usize>,
) -> Option<(Vec<Place>, Cost)> {
    let end = places.len() - 1;
    // For each number of tiles and each place: the cheapest division of the ink before it, and the place before.
    let mut rows: Vec<Vec<Option<(Cost, usize)>>> = Vec::new();
    let mut best: Option<(Cost, usize)> = None;
    for count in 1..=most {
        let before: Option<&Vec<Option<(Cost, usize)>>> = rows.last();
        let mut row: Vec<Option<(Cost, usize)>> = vec![None; places.len()];
        for to in 1..=end {
            for from in (0..to).rev() {
                let width = places[to].ink_before() - places[from].ink_after();
                if width > widest {
                    break;
                }
                let so_far = match before {
                    None => (from == 0).then_some((0, [0, 0], 0.0)),
                    Some(row) => row[from].map(|(cost, _)| cost),
                };
                let Some((slivers, cuts, squares)) = so_far.filter(|_| width >= 0.0) else { continue };
                let Place { first, price, .. } = &places[to];
                let cuts = [cuts[0] + first[0], cuts[1] + first[1]];
                let slivers = slivers + u32::from(is_sliver(&places[from], &places[to], narrow));
                let cost = (slivers, cuts, squares + width * width + price);
                if row[to].is_none_or(|(known, _)| is_cheaper(&cost, &known)) {
                    row[to] = Some((cost, from));
                }
            }
        }
        let reached = row[end].map(|(cost, _)| cost);
        rows.push(row);
        let Some(cost) = reached.filter(|_| exactly.is_none_or(|exactly| exactly == count)) else { continue };
        // A contour that fits into a tile is worth another tile, one that does not is not.
        if best.is_none_or(|(known, _)| cost.1[0] < known.1[0]) {
            best = Some((cost, count));
        }
        if cost.1[0] == 0 {
            break;
        }
    }
    let (cost, count) = best?;
    let mut chosen = vec![places[end]];
    let mut at = end;
    for row in rows[..count].iter().rev() {
        at = row[at]?.1;
        chosen.push(places[at]);
    }
    chosen.reverse();
    Some((chosen, cost))
}

/// The chosen places, moved within their room: to the middle of a gap, and otherwise so that neighbouring tiles become
/// equally wide.
fn spread(chosen: &[Place]) -> Vec<Place> {
    let mut spread: Vec<Place> = chosen.to_vec();
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
            let middle = f64::midpoint(spread[index - 1].ink_after(), spread[index + 1].ink_before());
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

fn tiling(places: &[Place], overlap: f64, enough: Option<usize>) -> Tiling {
    let last = places.len() - 1;
    let cuts = places[1..last]
        .iter()
        .map(|place| Cut { at: place.at, is_through_ink: place.is_through_ink() })
        .collect();
    let beyond = |place: &Place| if place.is_through_ink() { overlap / 2.0 } else { 0.0 };
    let tiles = places
        .windows(2)
        .map(|pair| [pair[0].ink_after() - beyond(&pair[0]), pair[1].ink_before() + beyond(&pair[1])])
        .collect();
    Tiling { cuts, tiles, enough }
}
