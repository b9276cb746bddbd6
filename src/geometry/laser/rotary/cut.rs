//! Cuts contours at lines along the part.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::{Cut, Unrolled};
use crate::geometry::pattern::{Path, Segment, Shape};
use crate::geometry::space::FlatPoint;

/// Paths that are cut together or not at all: one contour, or the contours of a fill that are at the same angles.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// The indices of the paths, in drawing order.
    pub paths: Vec<usize>,
    /// The smallest and the largest angle, rad.
    pub span: [f64; 2],
}

/// The index of a path with its smallest and largest angle, rad.
type Spanning = (usize, [f64; 2]);

/// The paths of a drawing as items, in drawing order.
pub fn items(paths: &[Path], unrolled: &Unrolled) -> Vec<Item> {
    let mut items = Vec::new();
    let mut fills: BTreeMap<(usize, u32), Vec<Spanning>> = BTreeMap::new();
    for (index, path) in paths.iter().enumerate() {
        let span = unrolled.span(path);
        match path.region.filter(|_| path.is_contour()) {
            Some(region) => fills.entry((path.layer, region)).or_default().push((index, span)),
            None => items.push(Item { paths: vec![index], span }),
        }
    }
    for mut contours in fills.into_values() {
        contours.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
        let mut joined: Vec<Item> = Vec::new();
        for (index, span) in contours {
            match joined.last_mut().filter(|last| span[0] <= last.span[1]) {
                Some(last) => {
                    last.paths.push(index);
                    last.span[1] = last.span[1].max(span[1]);
                }
                None => joined.push(Item { paths: vec![index], span }),
            }
        }
        items.extend(joined);
    }
    for item in &mut items {
        item.paths.sort_unstable();
    }
    items.sort_by_key(|item| item.paths[0]);
    items
}

/// The borders of one tile, rad; `None` beside the first and the last.
#[derive(Debug, Clone, Copy)]
struct Window {
    lower: Option<f64>,
    upper: Option<f64>,
}

impl Window {
    fn contains(&self, angle: f64) -> bool {
        self.lower.is_none_or(|lower| angle >= lower) && self.upper.is_none_or(|upper| angle <= upper)
    }

    fn borders(&self) -> impl Iterator<Item = f64> {
        self.lower.into_iter().chain(self.upper)
    }
}

/// The paths of tile `number` between the cuts, at their places in the drawing. An item between two cuts is whole. An item
/// that a cut crosses is cut half the overlap (rad) beyond it: lines become open pieces, and fills are closed along the
/// border. `radius` is the largest distance of the ink from the axis, mm.
pub fn tile(
    paths: &[Path],
    items: &[Item],
    unrolled: &Unrolled,
    cuts: &[Cut],
    number: usize,
    overlap: f64,
    radius: f64,
) -> Vec<Path> {
    let before = number.checked_sub(1).and_then(|index| cuts.get(index));
    let after = cuts.get(number);
    let tile_at = |angle: f64| cuts.iter().filter(|cut| cut.at <= angle).count();
    let border = |angle: f64| unrolled.clear_of_corners(angle, paths, radius);
    let reach =
        |cut: &Cut, side: f64| border(cut.at + side * if cut.is_through_ink { overlap / 2.0 } else { 0.0 });
    let reached =
        Window { lower: before.map(|cut| reach(cut, -1.0)), upper: after.map(|cut| reach(cut, 1.0)) };
    let mut tile = Vec::new();
    for item in items {
        let [from, to] = item.span;
        let of_item = item.paths.iter().filter_map(|index| paths.get(*index));
        if tile_at(from) == tile_at(to) {
            if tile_at(from) == number {
                tile.extend(of_item.cloned());
            }
            continue;
        }
        if !(reached.lower.is_none_or(|lower| to > lower) && reached.upper.is_none_or(|upper| from < upper)) {
            continue;
        }
        let contours: Vec<&Path> = of_item.collect();
        if contours.iter().all(|path| path.region.is_some() && path.is_contour()) {
            tile.extend(cut_fill(&contours, unrolled, &reached));
        } else {
            tile.extend(contours.into_iter().flat_map(|path| cut_line(path, unrolled, &reached)));
        }
    }
    tile
}

/// Pieces of a segment between the borders, each with whether it is inside.
fn sections(segments: &[Segment], unrolled: &Unrolled, window: &Window) -> Vec<(Segment, bool)> {
    let mut sections = Vec::with_capacity(segments.len());
    for segment in segments {
        let mut ends = vec![0.0];
        for border in window.borders() {
            let (from, direction) = unrolled.generator(border);
            let normal = Vector2::new(-direction.y, direction.x);
            let is_on_part = |t: &f64| {
                // Beyond the apex of a cone the line continues at other angles.
                (unrolled.angle(segment.point(*t)) - border).abs() < 1e-3
            };
            ends.extend(crossings(segment, from, normal).into_iter().filter(is_on_part));
        }
        ends.push(1.0);
        ends.sort_by(f64::total_cmp);
        ends.dedup_by(|next, last| *next - *last < 1e-12);
        for pair in ends.windows(2) {
            let section = match ends.len() {
                2 => segment.clone(),
                _ => segment.section(pair[0], pair[1]),
            };
            let is_inside = window.contains(unrolled.angle(section.point(0.5)));
            sections.push((section, is_inside));
        }
    }
    sections
}

/// The pieces of a line inside the window.
fn cut_line(path: &Path, unrolled: &Unrolled, window: &Window) -> Vec<Path> {
    let with = |shape: Shape| Path { shape, ..path.clone() };
    match &path.shape {
        Shape::Dot(at) => {
            if window.contains(unrolled.angle(*at)) {
                vec![path.clone()]
            } else {
                Vec::new()
            }
        }
        Shape::Open(segments) => {
            let runs = runs(&sections(segments, unrolled, window));
            runs.into_iter().map(|run| with(Shape::Open(run))).collect()
        }
        Shape::Closed(segments) => match runs_round(sections(segments, unrolled, window)) {
            None => vec![path.clone()],
            Some(runs) => runs.into_iter().map(|run| with(Shape::Open(run))).collect(),
        },
    }
}

/// The runs of sections that are inside.
fn runs(sections: &[(Segment, bool)]) -> Vec<Vec<Segment>> {
    let runs = sections.chunk_by(|a, b| a.1 == b.1).filter(|run| run[0].1);
    runs.map(|run| run.iter().map(|(segment, _)| segment.clone()).collect()).collect()
}

/// The runs of sections of a contour that are inside; `None` if it is inside all the way round.
fn runs_round(mut sections: Vec<(Segment, bool)>) -> Option<Vec<Vec<Segment>>> {
    // Beginning outside, no run goes over the start of the contour.
    let outside = sections.iter().position(|(_, is_inside)| !is_inside)?;
    sections.rotate_left(outside);
    Some(runs(&sections))
}

/// The part of a fill inside the window: closed contours by the even-odd rule.
fn cut_fill(contours: &[&Path], unrolled: &Unrolled, window: &Window) -> Vec<Path> {
    let mut filled = Vec::new();
    let mut pieces: Vec<Vec<Segment>> = Vec::new();
    for path in contours {
        let mut segments = path.shape.segments().to_vec();
        if let (Some(first), Some(last)) =
            (segments.first().map(Segment::start), segments.last().map(Segment::end))
            && first != last
        {
            segments.push(Segment::Line { from: last, to: first });
        }
        match runs_round(sections(&segments, unrolled, window)) {
            None => filled.push((*path).clone()),
            Some(runs) => pieces.extend(runs),
        }
    }
    let Some(first) = contours.first() else { return filled };
    let loops = closed_along(&pieces, unrolled, window);
    filled.extend(
        loops.into_iter().map(|segments| Path { shape: Shape::Closed(segments), ..(*first).clone() }),
    );
    filled
}

/// Pieces that end at the borders, joined along the borders: inside of a fill are the stretches of a border between its
/// first and second crossing, between its third and fourth, and so on.
fn closed_along(pieces: &[Vec<Segment>], unrolled: &Unrolled, window: &Window) -> Vec<Vec<Segment>> {
    // The start of piece n is end 2n, its end is 2n + 1.
    let point = |end: usize| {
        let piece = pieces.get(end / 2)?;
        if end.is_multiple_of(2) { piece.first().map(Segment::start) } else { piece.last().map(Segment::end) }
    };
    let mut partner = vec![None; 2 * pieces.len()];
    let borders: Vec<f64> = window.borders().collect();
    for border in &borders {
        let (from, direction) = unrolled.generator(*border);
        let is_here = |at: FlatPoint| {
            let distance = |border: &f64| (unrolled.angle(at) - border).abs();
            borders.iter().all(|other| distance(border) <= distance(other))
        };
        let ends = (0..2 * pieces.len()).filter_map(|end| Some((end, point(end)?)));
        let mut ends: Vec<(usize, f64)> =
            ends.filter(|(_, at)| is_here(*at)).map(|(end, at)| (end, (at - from).dot(&direction))).collect();
        ends.sort_by(|a, b| a.1.total_cmp(&b.1));
        for pair in ends.chunks_exact(2) {
            partner[pair[0].0] = Some(pair[1].0);
            partner[pair[1].0] = Some(pair[0].0);
        }
    }
    let mut is_used = vec![false; pieces.len()];
    let mut loops = Vec::new();
    for start in 0..pieces.len() {
        let mut segments: Vec<Segment> = Vec::new();
        let mut at = 2 * start;
        while !is_used[at / 2] {
            is_used[at / 2] = true;
            let piece = &pieces[at / 2];
            if at.is_multiple_of(2) {
                segments.extend(piece.iter().cloned());
            } else {
                segments.extend(piece.iter().rev().map(Segment::reversed));
            }
            let Some(next) = partner[at ^ 1] else { break };
            if let (Some(from), Some(to)) = (point(at ^ 1), point(next))
                && from != to
            {
                segments.push(Segment::Line { from, to });
            }
            at = next;
        }
        if !segments.is_empty() {
            loops.push(segments);
        }
    }
    loops
}

/// The parameters between 0 and 1 at which a segment crosses the line through `from` with this normal, in rising order.
fn crossings(segment: &Segment, from: FlatPoint, normal: Vector2<f64>) -> Vec<f64> {
    let distance = |at: FlatPoint| normal.dot(&(at - from));
    let mut found: Vec<f64> = match segment {
        Segment::Line { from, to } => {
            let (before, after) = (distance(*from), distance(*to));
            if (before < 0.0) == (after < 0.0) { Vec::new() } else { vec![before / (before - after)] }
        }
        Segment::Arc { center, u, v, start, sweep } => {
            let (by_cos, by_sin, offset) = (normal.dot(u), normal.dot(v), distance(*center));
            let reach = by_cos.hypot(by_sin);
            if reach <= offset.abs() || *sweep == 0.0 {
                Vec::new()
            } else {
                let (middle, aside) = (by_sin.atan2(by_cos), (-offset / reach).acos());
                let turned = |angle: f64| ((angle - start) * sweep.signum()).rem_euclid(TAU) / sweep.abs();
                let rounds = (sweep.abs() / TAU).floor() as usize;
                [middle - aside, middle + aside]
                    .into_iter()
                    .flat_map(|angle| (0..=rounds).map(move |round| (angle, round)))
                    .map(|(angle, round)| turned(angle) + round as f64 * TAU / sweep.abs())
                    .filter(|t| *t <= 1.0)
                    .collect()
            }
        }
        Segment::Bezier { points, weights } => {
            let values: [f64; 4] = std::array::from_fn(|index| weights[index] * distance(points[index]));
            let mut found = Vec::new();
            bernstein_roots(values, [0.0, 1.0], &mut found);
            found
        }
    };
    found.retain(|t| *t > 0.0 && *t < 1.0);
    found.sort_by(f64::total_cmp);
    found
}

/// A piece of a curve that is nearer to a border than this, mm, is on it.
const ALONG: f64 = 1e-12;

/// The roots of a cubic polynomial with these Bernstein coefficients over `range`: by halving, because the polynomial is
/// within the range of its coefficients.
fn bernstein_roots(values: [f64; 4], [from, to]: [f64; 2], found: &mut Vec<f64>) {
    if values.iter().all(|value| *value > 0.0) || values.iter().all(|value| *value < 0.0) {
        return;
    }
    let middle = f64::midpoint(from, to);
    if to - from < 1e-14 || values.iter().all(|value| value.abs() < ALONG) {
        // A curve that only touches the border does not cross it.
        if (values[0] < 0.0) != (values[3] < 0.0) && found.last().is_none_or(|last| middle - last > 1e-12) {
            found.push(middle);
        }
        return;
    }
    let [a, b, c, d] = values;
    let (ab, bc, cd) = (f64::midpoint(a, b), f64::midpoint(b, c), f64::midpoint(c, d));
    let (abc, bcd) = (f64::midpoint(ab, bc), f64::midpoint(bc, cd));
    let abcd = f64::midpoint(abc, bcd);
    bernstein_roots([a, ab, abc, abcd], [from, middle], found);
    bernstein_roots([abcd, bcd, cd, d], [middle, to], found);
}
