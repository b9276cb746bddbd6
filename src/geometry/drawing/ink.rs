//! Where the drawing puts ink: short pieces along its lines, and small squares over its inked areas.

mod area;
mod open_areas;
mod outlines;

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector2;

use super::contour::Drawn;
use super::pattern::{Path, Pattern, Segment, Shape};
use crate::geometry::space::{Extents, FlatPoint};

/// Pieces shorter than this, mm, are joined to a neighbour, because their stretch cannot be measured. It is far above
/// rounding errors and a twentieth of the finest laser spot.
pub const SHORTEST: f64 = 1e-3;
/// A curve is divided further until its chords have this share of its length: a small circle as one chord would have
/// none.
const SHARE_OF_LENGTH: f64 = 0.98;
/// Maximum number of pieces, not counting those added at the ends of segments; beyond it, pieces are made longer.
const MAX_PIECES: f64 = 2e6;

/// Maximum number of squares in the bounding rectangle; beyond it, squares are made larger.
const MAX_SQUARES_IN_BOX: f64 = 4e6;

/// Squares show ink well if their area differs from the ink's own area by at most this share.
const SHOWN_WELL: f64 = 0.02;
/// Squares show ink roughly if their area differs from the ink's own area by at most this share.
const SHOWN: f64 = 0.25;

/// Chord tolerance for the inked area, as a share of the size of a contour.
const OF_REACH: f64 = 1e-3;

/// A remainder of the bounding rectangle is rounding if it is a smaller share of a square's side than this.
const ROUNDING: f64 = 1e-6;

/// A block has at most two to the power of this number of squares along a side.
const LARGEST_BLOCK: usize = 6;

/// With more pieces than this, consecutive pieces are joined, up to the requested length.
const MAX_SHORT_PIECES: usize = 200_000;

/// The drawing as samples: the quality results are sums over them, and they weight the length-true map.
#[derive(Debug, Clone, PartialEq)]
pub struct Ink {
    /// Pieces of all curves: no longer than requested, unless there would be more than two million, and no shorter
    /// than [`SHORTEST`].
    pub pieces: Vec<Piece>,
    /// Single spots.
    pub dots: Vec<FlatPoint>,
    /// Centres of those squares of an axis-parallel grid that are inside the inked area.
    pub squares: Vec<FlatPoint>,
    /// The same squares, put together into the largest blocks that are inked all over.
    pub blocks: Vec<Block>,
    /// Side of the squares, mm.
    pub side: f64,
    /// The inked area, mm²: ink that is finer than the squares has the centres of too many or too few of them.
    pub inked_area: f64,
    /// The bounding rectangle of everything, including dots.
    pub extents: Extents,
}

/// A short piece of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Start, mm.
    pub from: FlatPoint,
    /// End, mm.
    pub to: FlatPoint,
}

/// Squares of the inked area that are together a square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Centre of the lower left square, mm.
    pub first: FlatPoint,
    /// Number of squares along a side: a power of two.
    pub count: u32,
}

impl Block {
    /// Number of squares.
    pub fn squares(&self) -> usize {
        (self.count as usize).pow(2)
    }

    /// The centre, mm, for squares with sides of `side` mm.
    pub fn center(&self, side: f64) -> FlatPoint {
        let half = f64::from(self.count - 1) / 2.0 * side;
        FlatPoint::new(self.first.x + half, self.first.y + half)
    }

    /// The four corners, mm.
    pub fn corners(&self, side: f64) -> [FlatPoint; 4] {
        let (center, half) = (self.center(side), f64::from(self.count) / 2.0 * side);
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| FlatPoint::new(center.x + x * half, center.y + y * half))
    }

    /// The centres of its squares, row by row, mm.
    pub fn each(self, side: f64) -> impl Iterator<Item = FlatPoint> {
        let at = move |row: u32, column: u32| {
            FlatPoint::new(self.first.x + f64::from(column) * side, self.first.y + f64::from(row) * side)
        };
        (0..self.count).flat_map(move |row| (0..self.count).map(move |column| at(row, column)))
    }

    /// The centres of six squares that represent a block of at least four along a side, mm: two at its middle, and one in each
    /// quarter. Over them, a mean with [`weight`](Self::weight) for the quarters is exact for quadratics.
    pub fn places(&self, side: f64) -> [FlatPoint; 6] {
        let (quarter, half) = (self.count / 4, self.count / 2);
        let [low, high] = [quarter.max(1) - 1, 3 * quarter];
        [[half.max(1) - 1; 2], [half; 2], [low, low], [high, low], [high, high], [low, high]].map(|[x, y]| {
            FlatPoint::new(self.first.x + f64::from(x) * side, self.first.y + f64::from(y) * side)
        })
    }

    /// The weight of the mean over the quarters; the rest is that of the middle.
    pub fn weight(&self) -> f64 {
        let count = f64::from(self.count);
        // Mean squares of the distances from the middle: of all squares but for those at the middle, and of the quarters.
        let [all, quarters, middle] = [(count * count - 1.0) / 12.0, (count / 4.0 + 0.5).powi(2), 0.25];
        (all - middle) / (quarters - middle)
    }

    /// Its quarters; of a single square, itself.
    fn quarters(self, side: f64) -> impl Iterator<Item = Self> {
        let (half, count) = (self.count / 2, (self.count / 2).max(1));
        let step = f64::from(half) * side;
        let at = move |x: f64, y: f64| FlatPoint::new(self.first.x + x * step, self.first.y + y * step);
        let quarters = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
        quarters.into_iter().take(if half > 0 { 4 } else { 1 }).map(move |first| Self { first, count })
    }
}

/// Whether `one` is before `other` in the order of the squares: by rows.
pub(crate) fn is_before(one: FlatPoint, other: FlatPoint) -> bool {
    (one.y, one.x) < (other.y, other.x)
}

impl Piece {
    /// Straight length, mm.
    pub fn length(&self) -> f64 {
        self.from.distance(self.to)
    }
}

impl Ink {
    /// Samples the paths on layers for which `is_marked` is true (given the layer's name) with pieces of at most
    /// `piece` mm and squares of `side` mm.
    ///
    /// The inked area of a layer is bounded by its contours under the even-odd rule; a contour that is drawn
    /// twice has the effect of one. A fill (HATCH, SOLID) is a separate region. An area covered by several
    /// regions is included once.
    pub fn sample(pattern: &Pattern, is_marked: impl Fn(&str) -> bool, piece: f64, side: f64) -> Self {
        Self::sample_marked(pattern, &is_marked, piece, side, |_| true)
    }

    /// The same without the areas inside outlines that nothing fills: there, a laser marks only the lines.
    pub fn sample_as_marked(
        pattern: &Pattern,
        is_marked: impl Fn(&str) -> bool,
        piece: f64,
        side: f64,
    ) -> Self {
        Self::sample_marked(pattern, &is_marked, piece, side, |region| region.is_some())
    }

    /// Compiled once, with the geometry: generic functions are compiled where they are called. `is_inked` is whether the contours
    /// of a layer with this region bound an inked area.
    fn sample_marked(
        pattern: &Pattern,
        is_marked: &dyn Fn(&str) -> bool,
        piece: f64,
        side: f64,
        is_inked: fn(Option<u32>) -> bool,
    ) -> Self {
        let (mut pieces, mut dots) = (Vec::new(), Vec::new());
        let inked = || inked(pattern, is_marked);
        let (mut extents, mut length) = (Extents::EMPTY, 0.0);
        for segment in inked().flat_map(|path| path.shape.segments()) {
            length += chords(segment, segment.steps(FINE), |point| extents.include(point.coords()));
        }
        let piece = piece.max(length / MAX_PIECES);
        for path in inked() {
            if let Shape::Dot(point) = path.shape {
                extents.include(point.coords());
                dots.push(point);
            }
            let stations = stations(&path.shape, piece);
            pieces.extend(stations.windows(2).map(|ends| Piece { from: ends[0], to: ends[1] }));
        }
        let mut contours = contours(pattern, is_marked, side / 40.0);
        contours.retain(|(_, region), _| is_inked(*region));
        if pieces.len() > MAX_SHORT_PIECES {
            join_consecutive(&mut pieces, piece);
        }
        let size = extents.size();
        let side = side.max((size.x * size.y / MAX_SQUARES_IN_BOX).max(0.0).sqrt());
        let (mut squares, mut blocks, mut inked_area) = (Vec::new(), Vec::new(), 0.0);
        if !contours.is_empty() {
            let groups: Vec<_> = contours.values().map(Vec::as_slice).collect();
            inked_area = area::inside(&finer(pattern, is_marked, is_inked, side), &extents, side);
            let inked = grid_inside(&groups, &extents, side);
            squares = inked.centers();
            blocks = inked.into_blocks();
        }
        Self { pieces, dots, squares, blocks, side, inked_area, extents }
    }

    /// Examines the inked area block by block. `choose` gets what `examine` returned for all blocks and decides which of
    /// them to divide into quarters; this ends when it chooses none. Both share `state`.
    pub(crate) fn survey<S, T>(
        &self,
        state: &mut S,
        mut examine: impl FnMut(&mut S, Block) -> T,
        mut choose: impl FnMut(&S, &[(Block, T)]) -> Vec<bool>,
    ) -> Vec<(Block, T)> {
        let mut patches = Vec::with_capacity(self.blocks.len());
        for block in &self.blocks {
            patches.push((*block, examine(state, *block)));
        }
        loop {
            let chosen = choose(state, &patches);
            if !chosen.iter().zip(&patches).any(|(chosen, (block, _))| *chosen && block.count > 1) {
                return patches;
            }
            let mut next = Vec::with_capacity(patches.len());
            for ((block, found), chosen) in patches.into_iter().zip(chosen) {
                if chosen && block.count > 1 {
                    next.extend(block.quarters(self.side).map(|quarter| (quarter, examine(state, quarter))));
                } else {
                    next.push((block, found));
                }
            }
            patches = next;
        }
    }

    /// Sum of the lengths of all pieces, mm.
    pub fn length(&self) -> f64 {
        self.pieces.iter().map(Piece::length).sum()
    }

    /// Inked area, mm², over which the results are sums: that of the squares where they show the ink well; 0 if none shows it.
    pub fn area(&self) -> f64 {
        self.squares.len() as f64 * self.side * self.side * self.weight()
    }

    /// Whether the squares show the inked area at least roughly.
    pub(crate) fn is_shown(&self) -> bool {
        let sampled = self.squares.len() as f64 * self.side * self.side;
        (self.inked_area - sampled).abs() <= SHOWN * self.inked_area.max(self.side * self.side)
    }

    /// The weight of a square in sums over the inked area, as a share of its own area: 1 where the squares
    /// show the ink well.
    pub(crate) fn weight(&self) -> f64 {
        let sampled = self.squares.len() as f64 * self.side * self.side;
        let share = if sampled > 0.0 { self.inked_area / sampled } else { 1.0 };
        if (share - 1.0).abs() > SHOWN_WELL { share } else { 1.0 }
    }
}

/// The paths on layers for which `is_marked` is true.
fn inked(pattern: &Pattern, is_marked: impl Fn(&str) -> bool) -> impl Iterator<Item = &Path> {
    let is_ink: Vec<bool> = pattern.layers.iter().map(|layer| is_marked(&layer.name)).collect();
    pattern.paths.iter().filter(move |path| is_ink.get(path.layer).is_some_and(|is_ink| *is_ink))
}

/// The contours that bound the inked area, by layer and fill: those of one layer and of one fill together, by the even-odd
/// rule. Their points are within `tolerance` mm of them.
pub(super) fn contours(
    pattern: &Pattern,
    is_marked: impl Fn(&str) -> bool,
    tolerance: f64,
) -> BTreeMap<(usize, Option<u32>), Vec<Vec<FlatPoint>>> {
    let flattened = |paths: Vec<&Path>| paths.iter().map(|path| path.shape.flattened(tolerance)).collect();
    let groups = bounding_paths(pattern, is_marked);
    groups.into_iter().map(|(group, paths)| (group, flattened(paths))).collect()
}

/// The paths that bound the inked area, by layer and fill. Outlines that repeat the boundary of a fill of their layer are only
/// lines.
pub(crate) fn bounding_paths(
    pattern: &Pattern,
    is_marked: impl Fn(&str) -> bool,
) -> BTreeMap<(usize, Option<u32>), Vec<&Path>> {
    let mut groups: BTreeMap<_, Vec<&Path>> = BTreeMap::new();
    let mut outlines = BTreeSet::new();
    for path in inked(pattern, is_marked) {
        // A second, identical outline would turn the area of the first one into a hole.
        if path.is_contour() && (path.region.is_some() || outlines.insert((path.layer, Drawn::by(path)))) {
            groups.entry((path.layer, path.region)).or_default().push(path);
        }
    }
    let mut boundaries: BTreeMap<usize, Vec<&Path>> = BTreeMap::new();
    for ((layer, _), paths) in groups.iter().filter(|((_, region), _)| region.is_some()) {
        boundaries.entry(*layer).or_default().extend(paths);
    }
    for (layer, boundaries) in boundaries {
        if let Some(paths) = groups.get_mut(&(layer, None)) {
            let mut repeats = outlines::repeat_boundaries(paths, &boundaries).into_iter();
            paths.retain(|_| !repeats.next().unwrap_or_default());
        }
    }
    groups.retain(|_, paths| !paths.is_empty());
    groups
}

/// Chord tolerance for measuring lengths, mm.
const FINE: f64 = 1e-3;

/// Length of a segment divided into `count` chords, mm; calls `visit` with the ends of the chords.
fn chords(segment: &Segment, count: usize, mut visit: impl FnMut(FlatPoint)) -> f64 {
    let mut last = segment.point(0.0);
    visit(last);
    let mut length = 0.0;
    for step in 1..=count {
        let next = segment.point(step as f64 / count as f64);
        visit(next);
        length += last.distance(next);
        last = next;
    }
    length
}

/// Points along a curve, beginning at its start, at most `piece` mm and at least [`SHORTEST`] apart. Anything shorter
/// is joined to the piece before or after it; the end of the curve is omitted if it is too close to the last point.
/// Empty for a dot.
pub fn stations(shape: &Shape, piece: f64) -> Vec<FlatPoint> {
    let mut stations: Vec<FlatPoint> = shape.segments().first().map(Segment::start).into_iter().collect();
    for segment in shape.segments() {
        let fine = segment.steps(FINE);
        let length = chords(segment, fine, |_| {});
        let mut count = (length / piece).ceil().clamp(1.0, 1e6) as usize;
        while count < fine && chords(segment, count, |_| {}) < SHARE_OF_LENGTH * length {
            count = (2 * count).min(fine);
        }
        for step in 1..=count {
            let next = segment.point(step as f64 / count as f64);
            if !stations.last().is_some_and(|last| last.distance(next) < SHORTEST) {
                stations.push(next);
            }
        }
    }
    stations
}

/// Joins consecutive pieces into pieces of at most `longest` mm.
fn join_consecutive(pieces: &mut Vec<Piece>, longest: f64) {
    pieces.dedup_by(|next, piece| {
        let longer = Piece { from: piece.from, to: next.to };
        // If the joined piece is shorter than one of the two, the curve turns back there; joining would hide that.
        let is_joined =
            piece.to == next.from && (piece.length().max(next.length())..=longest).contains(&longer.length());
        if is_joined {
            *piece = longer;
        }
        is_joined
    });
}

/// The contours that bound the inked area, of each layer and fill, with the chord tolerance that their own sizes need, and without those
/// that are only rounding.
fn finer(
    pattern: &Pattern,
    is_marked: &dyn Fn(&str) -> bool,
    is_inked: fn(Option<u32>) -> bool,
    side: f64,
) -> Vec<Vec<Vec<FlatPoint>>> {
    let flattened = |path: &&Path| {
        let coarse = path.shape.flattened(side / 40.0);
        let reach = if coarse.is_empty() { 0.0 } else { area::extents_of(&coarse).size().max() };
        (reach > SHORTEST).then(|| match reach * OF_REACH < side / 40.0 {
            true => path.shape.flattened(reach * OF_REACH),
            false => coarse,
        })
    };
    let groups = bounding_paths(pattern, is_marked).into_iter().filter(|((_, region), _)| is_inked(*region));
    groups.map(|(_, paths)| paths.iter().filter_map(flattened).collect()).collect()
}

/// The squares of an axis-parallel grid, and those that are inside the contours of any group, by the even-odd rule in each.
fn grid_inside(groups: &[&[Vec<FlatPoint>]], extents: &Extents, side: f64) -> Inked {
    let Inked { origin, columns, rows, squares: mut inked, .. } = Inked::none(extents, side);
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); rows];
    for group in groups {
        crossings.iter_mut().for_each(Vec::clear);
        for contour in *group {
            for (from, to) in contour.iter().zip(contour.iter().cycle().skip(1)) {
                let (low, high) = if from.y < to.y { (from, to) } else { (to, from) };
                let row_at = |y: f64| ((y - origin.y) / side - 0.5).ceil().max(0.0) as usize;
                for row in row_at(low.y)..row_at(high.y).min(rows) {
                    let y = origin.y + (row as f64 + 0.5) * side;
                    crossings[row].push(low.x + (high.x - low.x) * ((y - low.y) / (high.y - low.y)));
                }
            }
        }
        for (row, crossings) in crossings.iter_mut().enumerate() {
            crossings.sort_unstable_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let column_at =
                    |x: f64| ((x - origin.x) / side - 0.5).ceil().clamp(0.0, columns as f64) as usize;
                inked[row * columns + column_at(pair[0])..row * columns + column_at(pair[1])].fill(true);
            }
        }
    }
    Inked { origin, side, columns, rows, squares: inked }
}

/// The centres of those squares of an axis-parallel grid that are filled when outlines are filled too: those inside the
/// fills of a layer or its outlines, but not of both, because what is inside a filled frame stays visible.
pub(crate) fn squares_filled(
    contours: &BTreeMap<(usize, Option<u32>), Vec<Vec<FlatPoint>>>,
    extents: &Extents,
    side: f64,
) -> Vec<FlatPoint> {
    let groups: Vec<_> = contours.iter().collect();
    let mut filled: Option<Inked> = None;
    for layer in groups.chunk_by(|((one, _), _), ((other, _), _)| one == other) {
        let part = |is_fill: bool| {
            let chosen = layer.iter().filter(|((_, region), _)| region.is_some() == is_fill);
            grid_inside(&chosen.map(|(_, contours)| contours.as_slice()).collect::<Vec<_>>(), extents, side)
        };
        let (mut inked, outlines) = (part(true), part(false));
        inked.squares.iter_mut().zip(outlines.squares).for_each(|(square, other)| *square ^= other);
        match &mut filled {
            None => filled = Some(inked),
            Some(all) => {
                all.squares.iter_mut().zip(inked.squares).for_each(|(square, other)| *square |= other);
            }
        }
    }
    filled.map_or_else(Vec::new, |filled| filled.centers())
}

/// The squares of a grid, and whether each is inked.
struct Inked {
    /// The lower left corner, mm.
    origin: FlatPoint,
    /// Side of a square, mm.
    side: f64,
    columns: usize,
    rows: usize,
    squares: Vec<bool>,
}

impl Inked {
    /// The grid over a rectangle, without inked squares.
    fn none(extents: &Extents, side: f64) -> Self {
        let size = extents.size() / side;
        // With a column more, the centres of the outermost squares would all be on the edges of a rectangle.
        let [columns, rows] = [size.x, size.y].map(|count| (count - ROUNDING).ceil() as usize);
        // Centred, so that a symmetric drawing is sampled symmetrically.
        let origin = extents.center() - Vector2::new(columns as f64, rows as f64) * (side / 2.0);
        Self { origin: origin.into(), side, columns, rows, squares: vec![false; columns * rows] }
    }

    /// Those squares of the grid over a rectangle that have these centres.
    fn of(centers: &[FlatPoint], extents: &Extents, side: f64) -> Self {
        let mut inked = Self::none(extents, side);
        for center in centers {
            let place = (*center - inked.origin) / side;
            let index = place.y as usize * inked.columns + place.x as usize;
            inked.squares.get_mut(index).into_iter().for_each(|inked| *inked = true);
        }
        inked
    }

    fn at(&self, column: usize, row: usize) -> bool {
        column < self.columns && self.squares.get(row * self.columns + column).copied().unwrap_or(false)
    }

    /// Column and row of the inked squares, row by row.
    fn places(&self) -> impl Iterator<Item = (usize, usize)> {
        let inked = self.squares.iter().enumerate().filter(|(_, inked)| **inked);
        inked.map(|(index, _)| (index % self.columns, index / self.columns))
    }

    fn center(&self, column: usize, row: usize) -> FlatPoint {
        self.origin + Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * self.side
    }

    fn centers(&self) -> Vec<FlatPoint> {
        self.places().map(|(column, row)| self.center(column, row)).collect()
    }

    /// The grid with squares of twice the side; one is inked if all four in it are.
    fn halved(&self) -> Self {
        let (columns, rows) = (self.columns / 2, self.rows / 2);
        let all = |index: usize| {
            let (column, row) = (index % columns * 2, index / columns * 2);
            let two = |row: usize| self.at(column, row) && self.at(column + 1, row);
            two(row) && two(row + 1)
        };
        let squares = (0..columns * rows).map(all).collect();
        Self { origin: self.origin, side: 2.0 * self.side, columns, rows, squares }
    }

    /// The inked squares, put together into the largest blocks that are inked all over.
    fn into_blocks(self) -> Vec<Block> {
        let mut levels = vec![self];
        while let Some(last) = levels.last().filter(|last| last.squares.contains(&true)) {
            if levels.len() > LARGEST_BLOCK {
                break;
            }
            levels.push(last.halved());
        }
        let mut blocks = Vec::new();
        for (level, here) in levels.iter().enumerate().rev() {
            let is_in_larger = |column: usize, row: usize| {
                levels.get(level + 1).is_some_and(|above| above.at(column / 2, row / 2))
            };
            for (column, row) in here.places().filter(|(column, row)| !is_in_larger(*column, *row)) {
                blocks.push(Block {
                    first: levels[0].center(column << level, row << level),
                    count: 1 << level,
                });
            }
        }
        blocks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pattern::{Affine, Color, Layer, Path, Segment, Source};

    fn square(half: f64, region: Option<u32>) -> Path {
        let corners =
            [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, y]| FlatPoint::new(x, y));
        let sides = (0..4).map(|side| Segment::Line { from: corners[side], to: corners[(side + 1) % 4] });
        let shape = Shape::Closed(sides.collect());
        Path { layer: 0, color: Color::ByLayer, shape, region, source: Source::default() }
    }

    fn ink(paths: Vec<Path>) -> Ink {
        let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
        Ink::sample(&Pattern { layers, paths }, |_| true, 0.25, 0.1)
    }

    impl Pattern {
        /// The outline of a square of twice `half`, mm, about the origin.
        pub(crate) fn outline(half: f64) -> Self {
            let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
            Self { layers, paths: vec![square(half, None)] }
        }
    }

    #[test]
    fn blocks_are_the_squares_put_together() {
        for half in [0.05, 0.1, 0.37, 3.2, 9.99] {
            for ink in
                [ink(vec![square(half, None)]), ink(vec![square(half, None), square(half / 3.0, None)])]
            {
                let key = |at: FlatPoint| [(at.x * 1e6).round() as i64, (at.y * 1e6).round() as i64];
                let mut found: Vec<_> =
                    ink.blocks.iter().flat_map(|block| block.each(ink.side)).map(key).collect();
                let mut squares: Vec<_> = ink.squares.iter().copied().map(key).collect();
                found.sort_unstable();
                squares.sort_unstable();
                assert_eq!(found, squares);
                let single =
                    |(): &(), all: &[(Block, u32)]| all.iter().map(|(_, count)| *count > 1).collect();
                let quarters = ink.survey(&mut (), |(), block| block.count, single);
                assert_eq!(quarters.len(), squares.len());
            }
        }
        let whole = ink(vec![square(3.2, None)]);
        assert_eq!(whole.blocks.len(), 1, "64 x 64 squares of 0.1 mm");
    }

    #[test]
    fn a_frame_has_the_right_area_and_length() {
        // Units and transforms leave rounding in the sizes.
        for rounding in [0.0, 1e-14, 1e-12, 1e-9, -1e-9] {
            let frame = ink(vec![square(5.0 + rounding, None), square(2.0, None)]);
            assert!((frame.area() - 84.0).abs() < 1e-6, "{rounding}: {}", frame.area());
        }
        let frame = ink(vec![square(5.0, None), square(2.0, None)]);
        assert!((frame.length() - 56.0).abs() < 1e-9);
        assert!(frame.pieces.iter().all(|piece| piece.length() <= 0.25 + 1e-12));
    }

    /// Their centres are as often in a square as beside it, or always, or never.
    #[test]
    fn the_area_of_dots_that_are_finer_than_the_squares_is_theirs() {
        let dot = |index: u32, radius: f64, pitch: f64| {
            let center = FlatPoint::new(f64::from(index % 20) * pitch, f64::from(index / 20) * pitch);
            let (u, v) = (Vector2::new(radius, 0.0), Vector2::new(0.0, radius));
            let circle = Segment::Arc { center, u, v, start: 0.0, sweep: 2.0 * std::f64::consts::PI };
            Path { shape: Shape::Closed(vec![circle]), ..square(1.0, None) }
        };
        for (radius, pitch) in [(0.05, 0.4), (0.05, 0.5), (0.11, 0.5), (0.15, 0.8), (0.3, 1.1)] {
            let dots = (0..400).map(|index| dot(index, radius, pitch)).collect();
            let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
            let pattern = Pattern { layers, paths: dots };
            let exact = 400.0 * std::f64::consts::PI * radius * radius;
            let found = crate::geometry::mapping::quality::sample(&pattern, |_| true);
            assert!((found.area() / exact - 1.0).abs() < 0.02, "{radius}: {} of {exact}", found.area());
            let sampled = found.squares.len() as f64 * found.side.powi(2);
            assert!((found.weight() * sampled / exact - 1.0).abs() < 0.03, "{radius}: {}", found.weight());
        }
        let turned = Pattern::outline(5.0).transformed(&Affine::rigid(
            FlatPoint::new(0.0, 0.0),
            0.7,
            FlatPoint::new(0.0, 0.0),
        ));
        let found = Ink::sample(&turned, |_| true, 0.25, 0.2);
        assert!((found.inked_area - 100.0).abs() < 0.1, "{}", found.inked_area);
        // What both of two fills cover counts once.
        let both = ink(vec![square(5.0, Some(1)), square(3.0, Some(2))]);
        assert!((both.inked_area - 100.0).abs() < 1e-6, "{}", both.inked_area);
    }

    /// Exporters write tiny closing pieces, and outlines that consist only of rounding errors.
    #[test]
    fn very_short_pieces_are_joined_to_a_neighbour() {
        let at = |x: f64| FlatPoint::new(x, 0.0);
        let line = |from: f64, to: f64| Segment::Line { from: at(from), to: at(to) };
        let path = |segments| Path { shape: Shape::Open(segments), ..square(1.0, None) };
        let sampled = ink(vec![
            path(vec![line(0.0, 1e-14), line(1e-14, 1.0), line(1.0, 1.0 + 1e-5)]),
            path(vec![line(5.0, 5.0 + 1e-14)]),
        ]);
        assert_eq!(sampled.pieces.len(), 4);
        assert!(sampled.pieces.iter().all(|piece| piece.length() >= SHORTEST));
        // Segments far shorter than that add up.
        let fine =
            ink(vec![path((0..10_000).map(|k| line(k as f64 * 1e-4, (k + 1) as f64 * 1e-4)).collect())]);
        assert!((fine.length() - 1.0).abs() <= SHORTEST && fine.pieces.len() <= 1000, "{}", fine.length());
    }

    /// With a single chord, a circle would have length zero.
    #[test]
    fn a_circle_smaller_than_a_piece_has_the_right_length() {
        for radius in [0.01, 0.04, 0.3, 10.0] {
            let circle = Segment::Arc {
                center: FlatPoint::new(3.0, 4.0),
                u: Vector2::new(radius, 0.0),
                v: Vector2::new(0.0, radius),
                start: 0.0,
                sweep: std::f64::consts::TAU,
            };
            let sampled = ink(vec![Path { shape: Shape::Closed(vec![circle]), ..square(1.0, None) }]);
            let share = sampled.length() / (std::f64::consts::TAU * radius);
            assert!((0.9..=1.0 + 1e-12).contains(&share), "{radius}: {share}");
        }
    }

    #[test]
    fn a_contour_with_a_repeated_point_has_an_area_but_a_stroke_has_none() {
        let around = square(5.0, None);
        let open = Path { shape: Shape::Open(around.shape.segments().to_vec()), ..around.clone() };
        assert_eq!(ink(vec![open.clone()]), ink(vec![around]));
        let stroke = Path { source: Source { is_stroke: true, ..Source::default() }, ..open.clone() };
        assert_eq!(ink(vec![stroke]).area(), 0.0);
        let Shape::Open(mut sides) = open.shape.clone() else { panic!() };
        sides.pop();
        assert_eq!(ink(vec![Path { shape: Shape::Open(sides), ..open }]).area(), 0.0);
    }

    #[test]
    fn a_contour_drawn_twice_keeps_its_area() {
        let back = match square(5.0, None).shape {
            Shape::Closed(sides) => Shape::Closed(sides.iter().rev().map(Segment::reversed).collect()),
            _ => panic!(),
        };
        let back = Path { shape: back, color: Color::Aci(1), ..square(5.0, None) };
        assert!((ink(vec![square(5.0, None), back]).area() - 100.0).abs() < 1e-9);
        // In a fill, the even-odd rule applies to all contours.
        assert_eq!(ink(vec![square(5.0, Some(1)), square(5.0, Some(1))]).area(), 0.0);
    }

    #[test]
    fn an_outline_round_a_fill_keeps_its_area() {
        assert!((ink(vec![square(5.0, None), square(5.0, Some(1))]).area() - 100.0).abs() < 1e-9);
    }
}
