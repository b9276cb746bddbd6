//! How much a surface changes within rectangles of the view, so that samples can be far apart where it is smooth.

use crate::geometry::facing_part::Uncertainty;
use crate::geometry::height_field::Node;
use crate::geometry::ink::{Block, Ink};
use crate::geometry::space::{Extents, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

/// Cells of the height field along a side of the smallest tile.
const TILE: usize = 2;
/// The image of a block reaches beyond that of its corners by at most this share.
const MARGIN: f64 = 0.25;
/// Up to this many squares of inked area are examined one by one.
const FEW_SQUARES: usize = 4000;

/// What is known of the surface within a rectangle of the view, from the nodes in and around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relief {
    /// Smallest and largest height of the nodes, mm, widened by what a curved surface reaches between them.
    pub heights: [f64; 2],
    /// Largest distance between the nodes and the fitted surface, mm.
    pub difference: f64,
    /// Largest slope of that distance.
    pub roughness: f64,
    /// Largest third derivative of the height, 1/mm²: how fast the curvature changes.
    pub change_of_curvature: f64,
    /// Largest doubt of the nodes, mm.
    pub doubt: f64,
    /// Largest uncertainty of the nodes.
    pub uncertainty: Uncertainty,
}

impl Relief {
    const NONE: Self = Self {
        heights: [f64::INFINITY, f64::NEG_INFINITY],
        difference: 0.0,
        roughness: 0.0,
        change_of_curvature: 0.0,
        doubt: 0.0,
        uncertainty: Uncertainty::NONE,
    };

    fn joined(self, other: Self) -> Self {
        Self {
            heights: [self.heights[0].min(other.heights[0]), self.heights[1].max(other.heights[1])],
            difference: self.difference.max(other.difference),
            roughness: self.roughness.max(other.roughness),
            change_of_curvature: self.change_of_curvature.max(other.change_of_curvature),
            doubt: self.doubt.max(other.doubt),
            uncertainty: self.uncertainty.largest(other.uncertainty),
        }
    }
}

/// How much of a rectangle of the view is smooth surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cover {
    /// All of it.
    All(Relief),
    /// Some of it, perhaps.
    Some,
    /// None of it.
    None,
}

impl Cover {
    fn joined(self, other: Self) -> Self {
        match (self, other) {
            (Self::All(one), Self::All(other)) => Self::All(one.joined(other)),
            (Self::None, Self::None) => Self::None,
            _ => Self::Some,
        }
    }
}

/// The relief of a surface in tiles, each level of them with twice the side of the level below.
#[derive(Debug, Clone)]
pub struct ReliefMap<'a> {
    surface: &'a FittedSurface,
    levels: Vec<Level>,
}

#[derive(Debug, Clone)]
struct Level {
    columns: usize,
    rows: usize,
    tiles: Vec<Cover>,
}

impl Level {
    fn halved(&self) -> Self {
        let (columns, rows) = (self.columns.div_ceil(2), self.rows.div_ceil(2));
        let joined = |index: usize| {
            let (column, row) = (index % columns * 2, index / columns * 2);
            self.joined([column, row], [(column + 1).min(self.columns - 1), (row + 1).min(self.rows - 1)])
        };
        Self { columns, rows, tiles: (0..columns * rows).map(joined).collect() }
    }

    fn joined(&self, from: [usize; 2], to: [usize; 2]) -> Cover {
        let tiles = (from[1]..=to[1]).flat_map(|row| (from[0]..=to[0]).map(move |column| [column, row]));
        let covers = tiles.map(|[column, row]| self.tiles[row * self.columns + column]);
        covers.reduce(Cover::joined).unwrap_or(Cover::None)
    }
}

impl<'a> ReliefMap<'a> {
    /// The relief of a surface, if `ink` covers enough area for it to save time.
    pub fn under(ink: &Ink, surface: &'a FittedSurface) -> Option<Self> {
        // `Ink` has public fields, so callers may change the squares alone.
        let in_blocks = || ink.blocks.iter().map(Block::squares).sum::<usize>();
        (ink.squares.len() > FEW_SQUARES && in_blocks() == ink.squares.len()).then(|| Self::of(surface))
    }

    /// The relief of a surface.
    pub fn of(surface: &'a FittedSurface) -> Self {
        let (columns, rows) = surface.field.size();
        let along = |nodes: usize| (nodes - 1).div_ceil(TILE);
        let (tiles_x, tiles_y) = (along(columns), along(rows));
        let tile = |index: usize| {
            let from = [index % tiles_x * TILE, index / tiles_x * TILE];
            tile(surface, from, [(from[0] + TILE).min(columns - 1), (from[1] + TILE).min(rows - 1)])
        };
        let tiles = (0..tiles_x * tiles_y).map(tile).collect();
        let mut levels = vec![Level { columns: tiles_x, rows: tiles_y, tiles }];
        while let Some(last) = levels.last().filter(|last| last.tiles.len() > 1) {
            levels.push(last.halved());
        }
        Self { surface, levels }
    }

    /// The same of a part that is known exactly between the vertices of its mesh.
    pub(super) fn without_doubt(mut self) -> Self {
        for cover in self.levels.iter_mut().flat_map(|level| &mut level.tiles) {
            if let Cover::All(relief) = cover {
                relief.uncertainty = Uncertainty::NONE;
            }
        }
        self
    }

    /// How far the slope of the part may be from the trend of samples that are `apart` mm from each other: on a smooth
    /// surface, by the change of the curvature between them, and no detail of the fitted surface is finer than its spans.
    /// The roughness adds to it.
    pub fn slope_between(&self, relief: &Relief, apart: f64) -> f64 {
        let (x, y) = self.surface.nurbs.knots();
        let bend = if apart > x.step().min(y.step()) { apart * apart / 8.0 } else { 0.0 };
        relief.roughness + relief.change_of_curvature * bend
    }

    /// A rectangle that contains the image of a block with corners at these places of the view.
    pub fn image(&self, corners: [ViewPoint; 4]) -> Extents {
        let area = Extents::of(corners.map(ViewPoint::coords));
        area.grown(area.size().max() * MARGIN)
    }

    /// What is known of the surface within a rectangle of the view.
    pub fn over(&self, area: &Extents) -> Cover {
        let grid = self.surface.field.grid();
        let last = grid.position(grid.columns - 1, grid.rows - 1).coords();
        let (min, max) = (area.min.sup(&grid.origin), area.max.inf(&last));
        // Also for coordinates that are not numbers.
        if !(area.min.x <= area.max.x && area.min.y <= area.max.y && min.x <= max.x && min.y <= max.y) {
            return Cover::None;
        }
        let (Some((left, low, _)), Some((right, high, _))) = (grid.cell(min.into()), grid.cell(max.into()))
        else {
            return Cover::Some;
        };
        let is_beyond = min != area.min || max != area.max;
        let [mut from, mut to] = [[left / TILE, low / TILE], [right / TILE, high / TILE]];
        let mut level = 0;
        while (to[0] - from[0]).max(to[1] - from[1]) > 3 && level + 1 < self.levels.len() {
            (from, to) = (from.map(|tile| tile / 2), to.map(|tile| tile / 2));
            level += 1;
        }
        let cover = self.levels[level].joined(from, to);
        if is_beyond { cover.joined(Cover::None) } else { cover }
    }
}

/// The relief of the cells between two nodes.
fn tile(surface: &FittedSurface, from: [usize; 2], to: [usize; 2]) -> Cover {
    smooth_tile(surface, from, to).map_or_else(
        || {
            let cells = (from[1]..to[1]).flat_map(|row| (from[0]..to[0]).map(move |column| [column, row]));
            let is_smooth = |[column, row]: [usize; 2]| {
                let nodes = surface.field.cell_nodes(column, row);
                nodes.iter().all(|&index| matches!(surface.field.nodes()[index], Node::Surface(_)))
            };
            if cells.into_iter().any(is_smooth) { Cover::Some } else { Cover::None }
        },
        Cover::All,
    )
}

/// The same where every node is on the smooth surface.
fn smooth_tile(surface: &FittedSurface, from: [usize; 2], to: [usize; 2]) -> Option<Relief> {
    let (columns, rows) = surface.field.size();
    let (nodes, step) = (surface.field.nodes(), surface.field.step());
    let height = |column: usize, row: usize| match nodes[row * columns + column] {
        Node::Surface(height) => Some(height),
        _ => None,
    };
    let mut relief = Relief::NONE;
    // Largest second differences along x and y, mm.
    let mut bends = [0.0f64; 2];
    for row in from[1]..=to[1] {
        for column in from[0]..=to[0] {
            let here = row * columns + column;
            let at = height(column, row)?;
            relief.heights = [relief.heights[0].min(at), relief.heights[1].max(at)];
            let difference = surface.differences()[here];
            relief.difference = relief.difference.max(difference.abs());
            relief.doubt = relief.doubt.max(surface.doubts().get(here).copied().unwrap_or(0.0));
            relief.uncertainty = relief.uncertainty.largest(surface.uncertainty_of(here));
            let slope = |to: usize| (surface.differences()[to] - difference) / step;
            let right = if column + 1 < columns { slope(here + 1) } else { 0.0 };
            let up = if row + 1 < rows { slope(here + columns) } else { 0.0 };
            relief.roughness = relief.roughness.max(right.hypot(up));
            // Along x, along y, and how the curvature along one changes along the other.
            let bend_x = |column: usize, row: usize| {
                Some(height(column + 2, row)? - 2.0 * height(column + 1, row)? + height(column, row)?)
            };
            let bend_y = |column: usize, row: usize| {
                Some(height(column, row + 2)? - 2.0 * height(column, row + 1)? + height(column, row)?)
            };
            if column + 2 < columns {
                bends[0] = bends[0].max(bend_x(column, row).unwrap_or(0.0).abs());
            }
            if row + 2 < rows {
                bends[1] = bends[1].max(bend_y(column, row).unwrap_or(0.0).abs());
            }
            let mut include = |change: Option<f64>| {
                let change = change.unwrap_or(0.0).abs() / step.powi(3);
                relief.change_of_curvature = relief.change_of_curvature.max(change);
            };
            let change = |first: Option<f64>, second: Option<f64>| Some(second? - first?);
            let (wide, high) = (column + 3 < columns, row + 3 < rows);
            if wide {
                include(change(bend_x(column, row), bend_x(column + 1, row)));
            }
            if high {
                include(change(bend_y(column, row), bend_y(column, row + 1)));
            }
            if wide && high {
                include(change(bend_x(column, row), bend_x(column, row + 1)));
                include(change(bend_y(column, row), bend_y(column + 1, row)));
            }
        }
    }
    // An arc is an eighth of its second difference beyond its ends; twice that where the curvature changes.
    let between = (bends[0] + bends[1]) / 4.0;
    relief.heights = [relief.heights[0] - between, relief.heights[1] + between];
    Some(relief)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::shapes;
    use crate::geometry::space::View;
    use crate::geometry::surface::fit::FitOptions;
    use nalgebra::Vector2;

    fn fitted(height: impl Fn(f64, f64) -> f64) -> FittedSurface {
        let part = FacingPart::new(&shapes::graph(25.0, 0.75, height), &View::top());
        FittedSurface::of_part(&part, &FitOptions::default()).unwrap()
    }

    #[test]
    fn the_relief_of_a_rectangle_holds_at_every_place_in_it() {
        let surface = fitted(shapes::mouse);
        let map = ReliefMap::of(&surface);
        for (x, y, size) in [(0.0, 0.0, 1.0), (-7.0, 5.0, 6.0), (6.0, -6.0, 10.0), (0.0, 1.0, 9.0)] {
            let corner = Vector2::new(x - size / 2.0, y - size / 2.0);
            let area = Extents { min: corner, max: corner + Vector2::repeat(size) };
            let Cover::All(relief) = map.over(&area) else { panic!("{area:?}") };
            for k in 0..400 {
                let share = Vector2::new(f64::from(k % 20), f64::from(k / 20)) / 19.0;
                let at = ViewPoint::from(corner + share * size);
                assert!(surface.difference(at).abs() <= relief.difference + 1e-12);
                let height = surface.sampled_height(at).unwrap();
                let [low, high] = relief.heights;
                assert!(low <= height && height <= high, "{height} in {low} to {high}");
            }
        }
        let square = |from: f64, to: f64| Extents { min: Vector2::repeat(from), max: Vector2::repeat(to) };
        assert_eq!(map.over(&square(14.0, 26.0)), Cover::Some);
        assert_eq!(map.over(&square(26.0, 28.0)), Cover::None);
        assert_eq!(map.over(&square(f64::NAN, 28.0)), Cover::None);
    }

    #[test]
    fn the_change_of_curvature_is_the_third_derivative_of_a_cubic() {
        let cubic = fitted(|x, y| 1e-4 * x * x * x + 0.01 * y * y);
        let area = Extents { min: Vector2::repeat(-5.0), max: Vector2::repeat(5.0) };
        let Cover::All(relief) = ReliefMap::of(&cubic).over(&area) else { panic!() };
        let found = relief.change_of_curvature;
        assert!((found - 6e-4).abs() < 2e-4, "{found}");
    }
}
