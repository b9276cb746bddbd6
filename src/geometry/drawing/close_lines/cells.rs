//! Pieces sorted by place, so that a piece is compared only with those near it.

use std::ops::Range;

use nalgebra::Vector2;

use super::super::ink::Piece;
use crate::geometry::space::FlatPoint;

/// Pieces are tested in groups of this size, without a branch for each.
const GROUP: usize = 8;
/// Number of bits of a row or column that are sorted at a time.
const DIGIT: u32 = 11;

/// Pieces sorted by the square cell that their middle is in: row by row, and in a cell in their own order.
pub(super) struct Cells {
    /// The pieces, as indices.
    order: Vec<u32>,
    /// What the first test of a pair needs, in the same order.
    groups: Vec<Group>,
    /// The cells that are not empty, and one after the last.
    cells: Vec<Cell>,
    /// Side of a cell, mm.
    side: f64,
    /// The lower left corner of the cell in row 0 and column 0, mm from the centre of all pieces.
    corner: Vector2<f64>,
    /// The largest widening, mm.
    widest: f64,
    /// Upper bound for what single precision changes in a distance, mm.
    rounding: f64,
}

/// A cell of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Cell {
    /// Row and column, from 1.
    at: [u32; 2],
    /// Position of its first piece.
    start: usize,
}

/// The pieces in a cell, and those in the nine cells in and round it, as positions.
pub(super) struct Neighbourhood {
    pub(super) own: Range<usize>,
    /// The start of each of the three cells in each of the three rows, and the end of the last.
    rows: [[usize; 4]; 3],
    /// The lower left corner of the cell in the middle, mm from the centre of all pieces.
    corner: Vector2<f64>,
}

impl Neighbourhood {
    /// Number of pieces in all nine cells.
    pub(super) fn count(&self) -> usize {
        self.rows.iter().map(|[from, .., to]| to - from).sum()
    }
}

impl Cells {
    /// Sorts the pieces into cells with sides of `side` mm. `widening` is by how much a piece, given by its index, widens each
    /// strip that is searched for it, mm.
    pub(super) fn sorted(pieces: &[Piece], side: f64, widening: impl Fn(usize) -> f64) -> Self {
        let middle = |piece: &Piece| piece.from.lerp(piece.to, 0.5);
        let cell_of = |at: FlatPoint| [at.y, at.x].map(|coordinate| (coordinate / side).floor());
        let [mut low, mut high] =
            [f64::INFINITY, f64::NEG_INFINITY].map(|extreme| FlatPoint::new(extreme, extreme));
        for at in pieces.iter().map(middle) {
            low = FlatPoint::new(low.x.min(at.x), low.y.min(at.y));
            high = FlatPoint::new(high.x.max(at.x), high.y.max(at.y));
        }
        let first = cell_of(low);
        // Each row and column has others on both sides. Casts saturate, at kilometres even for the smallest pieces.
        let number = |cell: f64, first: f64| ((cell - first + 1.0) as u32).min(u32::MAX - 4);
        let entry = |(index, piece): (usize, &Piece)| {
            let [row, column] = cell_of(middle(piece));
            Entry { at: [number(row, first[0]), number(column, first[1])], index: index as u32 }
        };
        let mut entries: Vec<Entry> = pieces.iter().enumerate().map(entry).collect();
        sort_by_cell(&mut entries);

        let mut cells: Vec<Cell> = Vec::new();
        for (start, entry) in entries.iter().enumerate() {
            if cells.last().is_none_or(|last| last.at != entry.at) {
                cells.push(Cell { at: entry.at, start });
            }
        }
        cells.push(Cell { at: [u32::MAX; 2], start: entries.len() });
        let order: Vec<u32> = entries.into_iter().map(|entry| entry.index).collect();
        let center = low.lerp(high, 0.5);
        let mut groups = vec![Group::default(); order.len().div_ceil(GROUP)];
        let mut widest = 0.0f64;
        for (position, index) in order.iter().map(|index| *index as usize).enumerate() {
            let (piece, widening) = (&pieces[index], widening(index));
            widest = widest.max(widening);
            let (offset, along, length) = (middle(piece) - center, piece.to - piece.from, piece.length());
            let values = [offset.x, offset.y, along.x / length, along.y / length, length / 2.0, widening];
            groups[position / GROUP].set(position % GROUP, values.map(|value| value as f32));
        }
        let corner = Vector2::new(first[1] - 1.0, first[0] - 1.0) * side - center.coords();
        // Each of the two coordinates is rounded twice, and the products of numbers not above two cells a few times more.
        let rounding = 8.0 * f64::from(f32::EPSILON) * (low.distance(high) / 2.0 + side);
        Self { order, groups, cells, side, corner, widest, rounding }
    }

    /// The cells that are not empty, row by row, each with those round it.
    pub(super) fn neighbourhoods(&self) -> impl Iterator<Item = Neighbourhood> {
        let mut bounds = [[0usize; 4]; 3];
        self.cells.windows(2).map(move |pair| {
            let [row, column] = pair[0].at;
            for (bounds, row) in bounds.iter_mut().zip(row - 1..) {
                for (bound, column) in bounds.iter_mut().zip(column - 1..) {
                    // The cells are visited in order, so the bounds only advance.
                    while self.cells[*bound].at < [row, column] {
                        *bound += 1;
                    }
                }
            }
            Neighbourhood {
                own: pair[0].start..pair[1].start,
                rows: bounds.map(|row| row.map(|bound| self.cells[bound].start)),
                corner: self.corner + Vector2::new(f64::from(column), f64::from(row)) * self.side,
            }
        })
    }

    /// The index of the piece at a position.
    pub(super) fn index(&self, position: usize) -> usize {
        self.order[position] as usize
    }

    /// Calls `visit` with the index of every other piece of the neighbourhood that is nearly in the strip. May visit some that are a
    /// little outside.
    pub(super) fn in_strip(&self, neighbourhood: &Neighbourhood, strip: Strip, mut visit: impl FnMut(usize)) {
        let (group, lane) = (&self.groups[strip.position / GROUP], strip.position % GROUP);
        let rounded = SingleStrip {
            middle: [group.x[lane], group.y[lane]],
            along: [group.along_x[lane], group.along_y[lane]],
            half_length: (strip.half_length + self.rounding) as f32,
            half_width: (strip.half_width + self.rounding) as f32,
            sine: strip.angle.sin() as f32 + 16.0 * f32::EPSILON,
        };
        for positions in self.crossed(neighbourhood, &rounded) {
            for number in positions.start / GROUP..positions.end.div_ceil(GROUP) {
                let first = number * GROUP;
                let mut near = self.groups[number].in_strip(&rounded);
                near &= u32::MAX << positions.start.saturating_sub(first);
                near &= !(u32::MAX << (positions.end - first).min(GROUP));
                while near != 0 {
                    let position = first + near.trailing_zeros() as usize;
                    near &= near - 1;
                    if position != strip.position {
                        visit(self.index(position));
                    }
                }
            }
        }
    }

    /// The positions of those pieces of a neighbourhood whose cells the strip crosses, row by row.
    fn crossed(&self, neighbourhood: &Neighbourhood, strip: &SingleStrip) -> [Range<usize>; 3] {
        let [x, y] = strip.middle.map(f64::from);
        let [along_x, along_y] = strip.along.map(f64::from);
        let corner = neighbourhood.corner - Vector2::new(x, y);
        let outside = f64::from(strip.half_width) + self.widest + self.rounding;
        [0usize, 1, 2].map(|row| {
            let starts = neighbourhood.rows[row];
            // Where along the strip its middle line is in this row, or so near that the strip can be.
            let low = corner.y + (row as f64 - 1.0) * self.side - outside;
            let ends = [low, low + self.side + 2.0 * outside].map(|y| y / along_y);
            let from = ends[0].min(ends[1]).max(-self.side);
            let to = ends[0].max(ends[1]).min(self.side);
            if from > to {
                return starts[0]..starts[0];
            }
            let ends = [from * along_x, to * along_x];
            let (left, right) = (ends[0].min(ends[1]) - outside, ends[0].max(ends[1]) + outside);
            let column = |x: f64| usize::from(corner.x <= x) + usize::from(corner.x + self.side <= x);
            starts[column(left)]..starts[column(right) + 1]
        })
    }
}

/// Where to search for pieces beside one. A piece is in the strip if its middle is. Along the strip, the
/// middle is at most half the length of the strip plus half its own length from the middle of the one. Across
/// the strip, it is at most half the width plus the widening. The directions of the two differ by at most the
/// angle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Strip {
    /// Position of the piece that the strip runs along.
    pub(super) position: usize,
    /// Half of its length, mm.
    pub(super) half_length: f64,
    /// Half of its width, mm.
    pub(super) half_width: f64,
    /// The largest angle, rad.
    pub(super) angle: f64,
}

/// A strip in single precision, a little larger.
struct SingleStrip {
    middle: [f32; 2],
    along: [f32; 2],
    half_length: f32,
    half_width: f32,
    sine: f32,
}

/// Some pieces, value by value, so that all are tested at the same time. Single precision doubles the number of these.
#[derive(Debug, Clone, Copy, Default)]
struct Group {
    /// The middles, mm from the centre of all pieces.
    x: [f32; GROUP],
    y: [f32; GROUP],
    /// The directions, of length 1.
    along_x: [f32; GROUP],
    along_y: [f32; GROUP],
    /// Half of the lengths, mm.
    half_length: [f32; GROUP],
    /// By how much each widens a strip, mm.
    widening: [f32; GROUP],
}

impl Group {
    fn set(&mut self, lane: usize, [x, y, along_x, along_y, half_length, widening]: [f32; 6]) {
        (self.x[lane], self.y[lane]) = (x, y);
        (self.along_x[lane], self.along_y[lane]) = (along_x, along_y);
        (self.half_length[lane], self.widening[lane]) = (half_length, widening);
    }

    /// A bit for each piece, the lowest for the first: whether it is in the strip.
    fn in_strip(&self, strip: &SingleStrip) -> u32 {
        let mut is_in = [0; GROUP];
        self.test(strip, &mut is_in);
        let any = is_in.iter().fold(0, |any, is_in| any | is_in);
        if any == 0 {
            return 0;
        }
        (0..GROUP).fold(0, |bits, lane| bits | is_in[lane] << lane)
    }

    /// Writes 1 for each piece in the strip and 0 for the others. Only in a function of its own, this becomes instructions for
    /// several pieces at a time.
    #[inline(never)]
    fn test(&self, strip: &SingleStrip, is_in: &mut [u32; GROUP]) {
        for lane in 0..GROUP {
            let offset_x = self.x[lane] - strip.middle[0];
            let offset_y = self.y[lane] - strip.middle[1];
            let along = strip.along[0] * offset_x + strip.along[1] * offset_y;
            let across = strip.along[0] * offset_y - strip.along[1] * offset_x;
            let sine = strip.along[0] * self.along_y[lane] - strip.along[1] * self.along_x[lane];
            is_in[lane] = u32::from(along.abs() <= strip.half_length + self.half_length[lane])
                & u32::from(across.abs() <= strip.half_width + self.widening[lane])
                & u32::from(sine.abs() <= strip.sine);
        }
    }
}

/// A piece and its cell.
#[derive(Debug, Clone, Copy)]
struct Entry {
    at: [u32; 2],
    index: u32,
}

/// Sorts by row, then column, and keeps the order in a cell. It sorts digit by digit, the lowest first: D. E. Knuth, The Art of
/// Computer Programming 3, 1998, algorithm 5.2.5 R, with counts in place of linked lists.
fn sort_by_cell(entries: &mut Vec<Entry>) {
    let mut spare = entries.clone();
    for part in [1, 0] {
        let highest = entries.iter().map(|entry| entry.at[part]).max().unwrap_or(0);
        for shift in (0..u32::BITS).step_by(DIGIT as usize).take_while(|shift| highest >> shift > 0) {
            let digit = |entry: &Entry| (entry.at[part] >> shift) as usize % (1 << DIGIT);
            let mut starts = [0usize; (1 << DIGIT) + 1];
            for entry in entries.iter() {
                starts[digit(entry) + 1] += 1;
            }
            for digit in 1..starts.len() {
                starts[digit] += starts[digit - 1];
            }
            for entry in entries.iter() {
                let start = &mut starts[digit(entry)];
                spare[*start] = *entry;
                *start += 1;
            }
            std::mem::swap(entries, &mut spare);
        }
    }
}
