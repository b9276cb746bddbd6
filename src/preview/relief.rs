//! The part as a soft relief: grey bands of equal brightness and thin lines of equal height.
//!
//! Bands are nested polygons, each painted over the darker one before it, so that there are no seams and the file stays
//! small. They are computed by marching squares (Lorensen and Cline, SIGGRAPH 1987, in two dimensions).

use std::borrow::Cow;

use super::HeightPicture;
use super::page::{PathData, number};
use crate::geometry::space::Extents;

/// Nodes along the longer side of the relief; finer grids are thinned, because the relief is only the background.
const MAX_NODES: usize = 240;
/// Colour of the places where the residual of the fitted surface is too large.
pub(super) const RESIDUAL: &str = "#c026d3";
/// The name of the drawn part.
pub(super) const PART: &str = "part";
/// Number of grey bands in the relief.
const BANDS: usize = 36;
/// Direction of the light in the view: from the upper left, in front.
const LIGHT: [f64; 3] = [-0.42, 0.50, 0.757];
/// Number of nodes beyond the rim that get their brightness from their neighbours.
const APRON: usize = 3;

/// The part behind the lines, which is the same in all previews of one part.
pub struct Backdrop {
    pub(super) relief: Option<Relief>,
    /// The elements that draw it.
    pub(super) definitions: String,
}

impl Backdrop {
    /// Draws the part; empty if the picture contains no surface.
    pub fn of(part: &HeightPicture) -> Self {
        Self::named(part, PART)
    }

    /// Draws one of the parts of a picture, as the element of this name.
    pub(super) fn named(part: &HeightPicture, name: &str) -> Self {
        let relief = relief(&part.thinned());
        let definitions = relief.as_ref().map(|relief| relief.definitions(name)).unwrap_or_default();
        Self { relief, definitions }
    }
}

/// The part's relief in SVG, in coordinates of the view (mm, y negated).
pub(super) struct Relief {
    /// The part's outline.
    pub(super) outline: PathData,
    /// Bands from dark to light: colour and region.
    pub(super) bands: Vec<(String, PathData)>,
    /// Lines of equal height.
    pub(super) contours: PathData,
    /// Distance in height between two lines, mm.
    pub(super) contour_step: f64,
    /// Where the residual is beyond its limit.
    pub(super) residual: PathData,
    /// That limit, mm.
    pub(super) residual_limit: f64,
    /// The bounding rectangle of the visible part, mm of the view.
    pub(super) extents: Extents,
}

/// A ring round nodes of a grid with this step, without the steps of the grid: each point is moved to the middle of its
/// neighbours many times, but no farther than the steps are high.
fn smoothed(ring: &[[f64; 2]], step: f64) -> Vec<[f64; 2]> {
    const PASSES: usize = 60;
    let limit = 0.6 * step;
    let count = ring.len();
    let mut points = ring.to_vec();
    for _ in 0..PASSES {
        let before = points.clone();
        for (index, point) in points.iter_mut().enumerate() {
            let [last, next] = [before[(index + count - 1) % count], before[(index + 1) % count]];
            let middle: [f64; 2] =
                std::array::from_fn(|axis| 0.5 * before[index][axis] + 0.25 * (last[axis] + next[axis]));
            let moved: [f64; 2] = std::array::from_fn(|axis| middle[axis] - ring[index][axis]);
            let share = (limit / moved[0].hypot(moved[1]).max(f64::MIN_POSITIVE)).min(1.0);
            *point = std::array::from_fn(|axis| ring[index][axis] + moved[axis] * share);
        }
    }
    points
}

/// Numbers at the nodes of the picture's grid; `None` where there is no surface.
#[derive(Clone)]
struct Grid {
    origin: [f64; 2],
    step: f64,
    columns: usize,
    rows: usize,
    values: Vec<Option<f64>>,
}

impl HeightPicture {
    /// The same with at most 240 nodes along each side, which show as much. Each residual is the largest of the nodes
    /// it replaces.
    #[must_use]
    pub fn thinned(&self) -> Cow<'_, Self> {
        let stride = self.columns.max(self.rows).div_ceil(MAX_NODES);
        if stride <= 1 {
            return Cow::Borrowed(self);
        }
        let row_from = |row: usize, column: usize| {
            (column..(column + stride).min(self.columns)).map(move |column| row * self.columns + column)
        };
        let kept = || {
            let rows = (0..self.rows).step_by(stride);
            rows.flat_map(|row| (0..self.columns).step_by(stride).map(move |column| (column, row)))
        };
        let height = |(column, row)| self.heights.get(row * self.columns + column).copied().flatten();
        let residual = |(column, row): (usize, usize)| {
            let nodes = (row..(row + stride).min(self.rows)).flat_map(|row| row_from(row, column));
            nodes.filter_map(|node| self.residuals.get(node)).map(|residual| residual.abs()).reduce(f64::max)
        };
        Cow::Owned(Self {
            origin: self.origin,
            step: self.step * stride as f64,
            columns: self.columns.div_ceil(stride),
            rows: self.rows.div_ceil(stride),
            heights: kept().map(height).collect(),
            residuals: match self.residuals.is_empty() {
                true => Vec::new(),
                false => kept().map(|node| residual(node).unwrap_or(f64::NAN)).collect(),
            },
            residual_limit: self.residual_limit,
        })
    }
}

/// The relief of a part; `None` if the picture contains no surface.
fn relief(part: &HeightPicture) -> Option<Relief> {
    let heights = Grid::of(part)?;
    let mut shades = heights.shades();
    for _ in 0..APRON {
        shades = shades.grown();
    }
    let (dark, light) = range(&shades.values)?;
    let bands = (1..BANDS).map(|band| {
        let share = band as f64 / BANDS as f64;
        let mut region = PathData::default();
        for ring in shades.region(dark + (light - dark) * share) {
            region.polygon(&simplified(&ring, 0.02 * heights.step));
        }
        (gray(dark + (light - dark) * share), region)
    });
    let bands = bands.filter(|(_, region)| !region.is_empty()).collect();

    let (lowest, highest) = range(&heights.values)?;
    let contour_step = round_step((highest - lowest) / 9.0);
    let mut contours = PathData::default();
    if highest - lowest > 1e-6 {
        let extended = heights.grown();
        let first = (lowest / contour_step).floor() as i64 + 1;
        let levels = (first..first + 64).map(|level| level as f64 * contour_step);
        for level in levels.take_while(|level| *level < highest) {
            for ring in extended.region(level) {
                let ring = simplified(&ring, 0.02 * heights.step);
                contours.polygon(&ring);
            }
        }
    }

    let mut residual = PathData::default();
    if part.residual_limit > 0.0 {
        for ring in Grid::of_residuals(part)?.region(part.residual_limit) {
            residual.polygon(&simplified(&ring, 0.02 * heights.step));
        }
    }

    let mut outline = PathData::default();
    let mut extents = Extents::EMPTY;
    let mut rim = heights.presence();
    for _ in 0..4 {
        rim = rim.blurred();
    }
    for ring in rim.region(0.5) {
        let ring = smoothed(&ring, heights.step);
        ring.iter().for_each(|point| extents.include((*point).into()));
        outline.polygon(&simplified(&ring, 0.02 * heights.step));
    }
    let residual_limit = part.residual_limit;
    Some(Relief { outline, bands, contours, contour_step, residual, residual_limit, extents })
}

impl Relief {
    /// The elements that draw the relief; a `<use>` of this name shows it, with lines of its stroke width.
    fn definitions(&self, name: &str) -> String {
        let mut text = format!(
            "<clipPath id=\"{name}-outline\"><path clip-rule=\"evenodd\" d=\"{0}\"/></clipPath>\n\
             <g id=\"{name}\">\n<g clip-path=\"url(#{name}-outline)\" fill-rule=\"evenodd\">\n\
             <path fill=\"{1}\" d=\"{0}\"/>\n",
            self.outline.text(),
            gray(0.0)
        );
        for (color, region) in &self.bands {
            text.push_str(&format!("<path fill=\"{color}\" d=\"{}\"/>\n", region.text()));
        }
        text.push_str(&format!(
            "<path stroke=\"#8a94a6\" stroke-opacity=\".4\" d=\"{}\"/>\n\
             <path fill=\"{RESIDUAL}\" fill-opacity=\".45\" d=\"{}\"/>\n\
             </g>\n<path stroke=\"#8a94a6\" d=\"{}\"/>\n</g>\n",
            self.contours.text(),
            self.residual.text(),
            self.outline.text()
        ));
        text
    }
}

impl Grid {
    /// The picture's heights, with an empty border.
    fn of(part: &HeightPicture) -> Option<Self> {
        let height =
            |node: usize| part.heights.get(node).copied().flatten().filter(|height| height.is_finite());
        let grid = Self::bordered(part, height)?;
        grid.values.iter().any(Option::is_some).then_some(grid)
    }

    /// The absolute residuals of the picture at the same nodes.
    fn of_residuals(part: &HeightPicture) -> Option<Self> {
        Self::bordered(part, |node| part.residuals.get(node).map(|residual| residual.abs()))
    }

    /// A value for each node of the picture, and an empty border.
    fn bordered(part: &HeightPicture, value: impl Fn(usize) -> Option<f64>) -> Option<Self> {
        let is_placed = part.origin.iter().all(|start| start.is_finite()) && part.step.is_finite();
        if part.columns == 0 || part.rows == 0 || !is_placed || part.step <= 0.0 {
            return None;
        }
        let border = APRON + 1;
        let (columns, rows) = (part.columns + 2 * border, part.rows + 2 * border);
        let mut values = vec![None; columns * rows];
        for row in 0..part.rows {
            for column in 0..part.columns {
                values[(row + border) * columns + column + border] = value(row * part.columns + column);
            }
        }
        let origin = part.origin.map(|start| start - border as f64 * part.step);
        Some(Self { origin, step: part.step, columns, rows, values })
    }

    fn at(&self, column: usize, row: usize) -> Option<f64> {
        self.values[row * self.columns + column]
    }

    fn with(&self, value: impl Fn(usize, usize) -> Option<f64>) -> Self {
        let nodes = (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| (column, row)));
        Self { values: nodes.map(|(column, row)| value(column, row)).collect(), ..self.clone() }
    }

    fn is_border(&self, column: usize, row: usize) -> bool {
        column == 0 || row == 0 || column + 1 == self.columns || row + 1 == self.rows
    }

    /// 1 where there is surface, 0 where there is none.
    fn presence(&self) -> Self {
        self.with(|column, row| Some(if self.at(column, row).is_some() { 1.0 } else { 0.0 }))
    }

    /// The mean over each node's neighbourhood, which smooths the staircase of a coarse rim.
    fn blurred(&self) -> Self {
        self.with(|column, row| {
            if self.is_border(column, row) {
                return self.at(column, row);
            }
            let weights = [(-1, 0.25), (0, 0.5), (1, 0.25)];
            let around =
                weights.iter().flat_map(|(up, a)| weights.iter().map(move |(right, b)| (*right, *up, a * b)));
            let sum = around.map(|(right, up, weight)| {
                let node = (column.wrapping_add_signed(right), row.wrapping_add_signed(up));
                weight * self.at(node.0, node.1).unwrap_or(0.0)
            });
            Some(sum.sum())
        })
    }

    /// The brightness of the surface, 0 to 1.
    fn shades(&self) -> Self {
        let slope = |before: Option<f64>, here: f64, after: Option<f64>| match (before, after) {
            (Some(before), Some(after)) => (after - before) / (2.0 * self.step),
            (Some(before), None) => (here - before) / self.step,
            (None, Some(after)) => (after - here) / self.step,
            (None, None) => 0.0,
        };
        self.with(|column, row| {
            let here = self.at(column, row)?;
            let x = slope(self.at(column - 1, row), here, self.at(column + 1, row));
            let y = slope(self.at(column, row - 1), here, self.at(column, row + 1));
            let upright = 1.0 / (1.0 + x * x + y * y).sqrt();
            let lit = (LIGHT[2] - LIGHT[0] * x - LIGHT[1] * y) * upright;
            Some(0.3 * upright + 0.7 * lit.max(0.0))
        })
    }

    /// The same values, and at the empty nodes next to them the mean of their neighbours.
    fn grown(&self) -> Self {
        self.with(|column, row| {
            if self.at(column, row).is_some() || self.is_border(column, row) {
                return self.at(column, row);
            }
            let around = (row - 1..=row + 1).flat_map(|y| (column - 1..=column + 1).map(move |x| (x, y)));
            let known: Vec<f64> = around.filter_map(|(x, y)| self.at(x, y)).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
        })
    }

    /// The region of values of at least `level`, as rings with the region on their left, mm.
    fn region(&self, level: f64) -> Vec<Vec<[f64; 2]>> {
        const NONE: usize = usize::MAX;
        let value = |column: usize, row: usize| {
            if self.is_border(column, row) {
                f64::NEG_INFINITY
            } else {
                self.at(column, row).unwrap_or(f64::NEG_INFINITY)
            }
        };
        // Edges 2n and 2n + 1 run from node n to the right and upwards; a ring goes from edge to edge.
        let mut next = vec![NONE; 2 * self.values.len()];
        for row in 0..self.rows - 1 {
            for column in 0..self.columns - 1 {
                let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| value(column + x, row + y));
                let inside = corners.map(|corner| corner >= level);
                let node = row * self.columns + column;
                let edges = [2 * node, 2 * (node + 1) + 1, 2 * (node + self.columns), 2 * node + 1];
                let is_exit = |edge: usize| inside[edge] && !inside[(edge + 1) % 4];
                let exits = (0..4).filter(|edge| is_exit(*edge)).count();
                let joined = corners.iter().sum::<f64>() / 4.0 >= level;
                for exit in (0..4).filter(|edge| is_exit(*edge)) {
                    let is_entry = |edge: usize| !inside[edge] && inside[(edge + 1) % 4];
                    let entry = match exits {
                        2 if joined => (exit + 1) % 4,
                        2 => (exit + 3) % 4,
                        _ => (0..4).find(|edge| is_entry(*edge)).unwrap_or(exit),
                    };
                    next[edges[exit]] = edges[entry];
                }
            }
        }
        let mut rings = Vec::new();
        for start in 0..next.len() {
            let mut ring = Vec::new();
            let mut edge = start;
            while next[edge] != NONE {
                ring.push(self.crossing(edge, level, value));
                edge = std::mem::replace(&mut next[edge], NONE);
            }
            if ring.len() > 2 {
                rings.push(ring);
            }
        }
        rings
    }

    /// The point where the level crosses an edge: its middle if one end has no value.
    fn crossing(&self, edge: usize, level: f64, value: impl Fn(usize, usize) -> f64) -> [f64; 2] {
        let (column, row) = (edge / 2 % self.columns, edge / 2 / self.columns);
        let (right, up) = if edge.is_multiple_of(2) { (1, 0) } else { (0, 1) };
        let (from, to) = (value(column, row), value(column + right, row + up));
        let along = (level - from) / (to - from);
        let along = if from.is_finite() && to.is_finite() { along.clamp(0.0, 1.0) } else { 0.5 };
        let place =
            |origin: f64, node: usize, turn: usize| origin + self.step * (node as f64 + along * turn as f64);
        [place(self.origin[0], column, right), place(self.origin[1], row, up)]
    }
}

/// The grey of a brightness: always pale, so that the lines stand out.
fn gray(shade: f64) -> String {
    let share = shade.clamp(0.0, 1.0).powf(1.4);
    let [red, green, blue] =
        [(170.0, 252.0), (178.0, 252.0), (190.0, 253.0)].map(|(dark, light)| dark + (light - dark) * share);
    format!("#{:02x}{:02x}{:02x}", red.round() as u8, green.round() as u8, blue.round() as u8)
}

/// The ring without points that are within `tolerance` mm of the chord that replaces them (Douglas and Peucker 1973).
fn simplified(ring: &[[f64; 2]], tolerance: f64) -> Vec<[f64; 2]> {
    let mut kept = vec![false; ring.len()];
    let half = ring.len() / 2;
    let mut open = vec![(0, half), (half, ring.len())];
    while let Some((first, last)) = open.pop() {
        kept[first] = true;
        let (a, b) = (ring[first], ring[last % ring.len()]);
        let far = (first + 1..last).map(|index| (index, off_chord(ring[index], a, b)));
        if let Some((index, worst)) = far.max_by(|x, y| x.1.total_cmp(&y.1))
            && worst > tolerance
        {
            open.extend([(first, index), (index, last)]);
        }
    }
    ring.iter().zip(kept).filter(|(_, kept)| *kept).map(|(point, _)| *point).collect()
}

fn off_chord(point: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let chord = [b[0] - a[0], b[1] - a[1]];
    let step = [point[0] - a[0], point[1] - a[1]];
    let squared = chord[0] * chord[0] + chord[1] * chord[1];
    let along = if squared > 0.0 { (step[0] * chord[0] + step[1] * chord[1]) / squared } else { 0.0 };
    let along = along.clamp(0.0, 1.0);
    (step[0] - chord[0] * along).hypot(step[1] - chord[1] * along)
}

fn range(values: &[Option<f64>]) -> Option<(f64, f64)> {
    let known = values.iter().flatten();
    known.fold(None, |range: Option<(f64, f64)>, value| {
        let (low, high) = range.unwrap_or((*value, *value));
        Some((low.min(*value), high.max(*value)))
    })
}

/// The smallest of 1, 2, 5 times a power of ten that is at least `length` mm.
pub(super) fn round_step(length: f64) -> f64 {
    let decade = 10f64.powf(length.max(1e-6).log10().floor());
    let rounds = [1.0, 2.0, 5.0].map(|round| round * decade);
    rounds.into_iter().find(|round| *round >= length * (1.0 - 1e-9)).unwrap_or(10.0 * decade)
}

/// A length with its unit, without trailing zeros.
pub(super) fn millimetres(length: f64) -> String {
    let text = number(length);
    if let Some(fraction) = text.strip_prefix('.') {
        format!("0.{fraction} mm")
    } else {
        format!("{text} mm")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(ring: &[[f64; 2]]) -> f64 {
        let sides = ring.iter().zip(ring.iter().cycle().skip(1));
        sides.map(|(a, b)| (a[0] * b[1] - a[1] * b[0]) / 2.0).sum()
    }

    fn dome(radius: f64, step: f64) -> HeightPicture {
        let nodes = (2.2 * radius / step) as usize;
        let start = -(nodes as f64 - 1.0) / 2.0 * step;
        let height = |index: usize| {
            let (x, y) = (start + step * (index % nodes) as f64, start + step * (index / nodes) as f64);
            let squared = radius * radius - x * x - y * y;
            (squared > 0.0).then(|| squared.sqrt())
        };
        let heights = (0..nodes * nodes).map(height).collect();
        HeightPicture {
            origin: [start, start],
            step,
            columns: nodes,
            rows: nodes,
            heights,
            ..HeightPicture::default()
        }
    }

    #[test]
    fn a_level_of_a_dome_is_a_circle_with_the_region_on_its_left() {
        let grid = Grid::of(&dome(30.0, 1.0)).unwrap();
        let rings = grid.region(24.0);
        assert_eq!(rings.len(), 1);
        assert!((area(&rings[0]) - std::f64::consts::PI * 18.0 * 18.0).abs() < 5.0);
        assert!(rings[0].iter().all(|point| (point[0].hypot(point[1]) - 18.0).abs() < 0.05));
    }

    #[test]
    fn a_hole_is_a_separate_ring() {
        let mut part = dome(30.0, 1.0);
        let middle = part.rows / 2 * part.columns + part.columns / 2;
        part.heights[middle] = None;
        let rings = Grid::of(&part).unwrap().presence().region(0.5);
        let areas: Vec<f64> = rings.iter().map(|ring| area(ring)).collect();
        assert_eq!(areas.iter().filter(|area| **area < 0.0).count(), 1, "{areas:?}");
        assert_eq!(rings.len(), 2);
    }

    #[test]
    fn a_fine_grid_does_not_make_the_relief_larger() {
        let relief = Backdrop::of(&dome(30.0, 0.05)).relief.unwrap();
        assert!((relief.extents.size().x - 60.0).abs() < 1.0);
        assert!(relief.definitions(PART).len() < 150_000, "{}", relief.definitions(PART).len());
    }

    #[test]
    fn a_picture_without_a_surface_gives_no_relief() {
        let nothing = HeightPicture { heights: vec![None; 9], columns: 3, rows: 3, ..dome(1.0, 0.5) };
        assert!(relief(&nothing).is_none());
        assert!(relief(&HeightPicture { columns: 0, rows: 0, heights: Vec::new(), ..nothing }).is_none());
    }

    #[test]
    fn rings_at_a_saddle_are_closed() {
        let heights = (0..25).map(|index| Some(f64::from((index % 2) as u8))).collect();
        let part = HeightPicture {
            origin: [0.0, 0.0],
            step: 1.0,
            columns: 5,
            rows: 5,
            heights,
            ..HeightPicture::default()
        };
        // The middle of each cell is 0.5: regions are separate above this level and joined below it.
        let rings = Grid::of(&part).unwrap().region(0.6);
        assert_eq!(rings.len(), 12);
        assert!(rings.iter().all(|ring| area(ring) > 0.0));
    }
}
