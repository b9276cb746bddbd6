//! The inked area of contours.

use crate::geometry::space::{Extents, FlatPoint};

/// Lines through the lowest contour, at least …
const LINES: f64 = 64.0;

/// … unless there would be more crossings with contours, or lines.
const MAX_CROSSINGS: f64 = 1e6;
const MAX_LINES: f64 = 1e5;

/// With more contours than this, it is not looked for which are in which.
const MAX_NESTED: usize = 2000;

/// The area inside the contours of any group, by the even-odd rule in each, mm². Contours that do not cross each other have exactly the
/// areas of polygons; `side` is twice the largest distance, mm, of the lines that measure the others.
pub(super) fn inside(groups: &[&[Vec<FlatPoint>]], extents: &Extents, side: f64) -> f64 {
    let (measured, off) = crossed_by_lines(groups, extents, side);
    let exact: Option<f64> = groups.iter().map(|group| nested(group)).sum();
    exact.filter(|exact| (exact - measured).abs() <= off).unwrap_or(measured)
}

/// The area of contours that do not cross, each inside or beside the others, mm²; `None` of very many.
fn nested(group: &[Vec<FlatPoint>]) -> Option<f64> {
    if group.len() > MAX_NESTED {
        return None;
    }
    let extents: Vec<Extents> =
        group.iter().map(|contour| Extents::of(contour.iter().map(|at| at.coords()))).collect();
    let depth = |index: usize| {
        let Some(start) = group[index].first() else { return 0 };
        let holds = |(other, extents): &(usize, &Extents)| {
            *other != index && extents.contains(start.coords()) && is_inside(*start, &group[*other])
        };
        extents.iter().enumerate().filter(holds).count()
    };
    let signed = |(index, contour): (usize, &Vec<FlatPoint>)| {
        if depth(index) % 2 == 0 { polygon(contour) } else { -polygon(contour) }
    };
    Some(group.iter().enumerate().map(signed).sum())
}

/// Whether a point is inside a contour, by the even-odd rule.
fn is_inside(at: FlatPoint, contour: &[FlatPoint]) -> bool {
    let ends = contour.iter().zip(contour.iter().cycle().skip(1));
    let left_of = |(from, to): &(&FlatPoint, &FlatPoint)| {
        (from.y > at.y) != (to.y > at.y)
            && at.x < from.x + (to.x - from.x) * ((at.y - from.y) / (to.y - from.y))
    };
    ends.filter(left_of).count() % 2 == 1
}

/// The area of a polygon that does not cross itself, mm² (Meister, Generalia de genesi figurarum planarum, 1769).
fn polygon(contour: &[FlatPoint]) -> f64 {
    let Some(start) = contour.first() else { return 0.0 };
    let ends = contour.windows(2);
    let twice = ends.map(|ends| {
        let [from, to] = [ends[0].coords() - start.coords(), ends[1].coords() - start.coords()];
        from.x * to.y - from.y * to.x
    });
    twice.sum::<f64>().abs() / 2.0
}

/// The size of a contour along x, mm.
fn width(contour: &[FlatPoint]) -> f64 {
    if contour.is_empty() { 0.0 } else { Extents::of(contour.iter().map(|at| at.coords())).size().x }
}

/// The area inside the contours of any group, by the even-odd rule in each, mm², and how far it may be off: the mean length of lines
/// through it, so close that the lowest contour has [`LINES`] of them. `side` is twice their largest distance, mm.
fn crossed_by_lines(groups: &[&[Vec<FlatPoint>]], extents: &Extents, side: f64) -> (f64, f64) {
    let height = extents.size().y;
    let (mut lowest, mut climb) = (f64::INFINITY, 0.0);
    for contour in groups.iter().copied().flatten() {
        let [low, high] = contour
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at.y), high.max(at.y)]);
        lowest = if high > low { f64::min(lowest, high - low) } else { lowest };
        let ends = contour.iter().zip(contour.iter().cycle().skip(1));
        climb += ends.map(|(from, to)| (to.y - from.y).abs()).sum::<f64>();
    }
    let apart = (lowest / LINES).min(side / 2.0).max(climb / MAX_CROSSINGS).max(height / MAX_LINES);
    if !(apart > 0.0 && apart.is_finite()) {
        return (0.0, 0.0);
    }
    let count = (height / apart).ceil().max(1.0);
    let apart = height / count;
    let mut inside: Vec<Vec<[f64; 2]>> = vec![Vec::new(); count as usize];
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); count as usize];
    for group in groups {
        for contour in *group {
            for (from, to) in contour.iter().zip(contour.iter().cycle().skip(1)) {
                let (low, high) = if from.y < to.y { (from, to) } else { (to, from) };
                let line_at = |y: f64| ((y - extents.min.y) / apart - 0.5).ceil().clamp(0.0, count) as usize;
                let lines = line_at(low.y)..line_at(high.y);
                for (line, crossings) in lines.clone().zip(&mut crossings[lines]) {
                    let y = extents.min.y + (line as f64 + 0.5) * apart;
                    crossings.push(low.x + (high.x - low.x) * ((y - low.y) / (high.y - low.y)));
                }
            }
        }
        for (crossings, inside) in crossings.iter_mut().zip(&mut inside) {
            crossings.sort_unstable_by(f64::total_cmp);
            inside.extend(crossings.chunks_exact(2).map(|pair| [pair[0], pair[1]]));
            crossings.clear();
        }
    }
    let covered = |mut inside: Vec<[f64; 2]>| {
        inside.sort_unstable_by(|one, other| one[0].total_cmp(&other[0]));
        let (mut length, mut reached) = (0.0, f64::NEG_INFINITY);
        for [from, to] in inside {
            length += (to - from.max(reached)).max(0.0);
            reached = to.max(reached);
        }
        length
    };
    // A contour begins and ends between two lines.
    let widths = groups.iter().copied().flatten().map(|contour| width(contour)).sum::<f64>();
    (apart * inside.into_iter().map(covered).sum::<f64>(), apart * widths)
}
