//! The triangular factors of a matrix with a symmetric pattern: Cholesky, or LU without pivoting.
//!
//! Every front of the elimination is a dense matrix: its own columns are factored, and the remainder is added to the
//! front that follows (Duff & Reid 1983; Liu, The multifrontal method for sparse matrix solution: theory and practice,
//! SIAM Review 34, 1992; Davis, Direct Methods for Sparse Linear Systems, 2006, section 4.11 and chapter 6).
//!
//! A matrix that is not symmetric has two sides: its lower triangle, and that of its transpose. Each is updated by
//! products with the other, and both are divided by the root of the pivot, so that A = L₀ L₁ᵀ; with one side, L₁ = L₀.
//! Without pivoting this is stable for matrices that are positive definite or diagonally dominant (Golub & Van Loan,
//! Matrix Computations, 2013, sections 4.1.1 and 4.2).
//!
//! Matrices are stored in tiles of 4 × 4 numbers, one row of tiles after the other, each tile column by column. Sums
//! always have the same order and no operation depends on the processor, so results are the same on every machine.

use std::collections::TryReserveError;
use std::ops::Range;

use multiversion::multiversion;

use super::elimination::{Elimination, filled};
use crate::geometry::fork::{Fork, join};

/// Rows and columns of a tile.
const SIDE: usize = 4;
/// Numbers of a tile.
const AREA: usize = SIDE * SIDE;
/// Tiles side by side that are factored before the rest is updated by their products: they stay in the cache.
const PANEL: usize = 24;
/// Rows of tiles that stay in the cache while others are multiplied by them.
const BLOCK: usize = 24;

/// Halves with fewer unknowns are factored faster than they are shared among threads.
const LEAST_HALF: usize = 400;
/// Halves with less than one in this many of all unknowns are not shared: there would be more of them than
/// threads.
const SMALLEST_SHARE: usize = 16;

/// Why there is no factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FactorError {
    /// A pivot is not a positive number.
    Pivot,
    /// There is not enough memory.
    Memory,
}

impl From<TryReserveError> for FactorError {
    fn from(_: TryReserveError) -> Self {
        Self::Memory
    }
}

/// The values of a matrix over the points of a grid.
pub(crate) trait Couplings<const COMPONENTS: usize, const SIDES: usize> {
    /// Calls `add` with every point to which `point` is coupled, itself included, and with the values: first those of
    /// the matrix in the other point's rows and this point's columns, then (with two sides) the same for the
    /// transpose. Points that are not unknowns may be included; values of the same pair are summed. No point is beyond
    /// the reach of the elimination.
    fn each(&self, point: usize, add: impl FnMut(usize, &[[[f64; COMPONENTS]; COMPONENTS]; SIDES]));
}

/// The triangular factors of a matrix.
#[derive(Debug, Clone)]
pub(crate) struct Factor<'a, const COMPONENTS: usize, const SIDES: usize> {
    elimination: &'a Elimination,
    /// The factors of two halves that are not coupled; empty where the matrix is not divided.
    halves: [Vec<Part<SIDES>>; 2],
    /// What follows them: the front that separates the halves, or all.
    top: Vec<Part<SIDES>>,
}

/// The numbers of some fronts, from the place `start` on, and those from `top` on, to which they are coupled.
struct Values<'v, Above> {
    start: usize,
    own: &'v mut [f64],
    top: usize,
    above: Above,
}

/// The factor of consecutive fronts.
#[derive(Debug, Clone)]
struct Part<const SIDES: usize> {
    fronts: Range<usize>,
    /// Front by front; on the diagonal, the reciprocals.
    sides: [Vec<f64>; SIDES],
}

/// What is factored.
struct Task<'a, Matrix> {
    elimination: &'a Elimination,
    matrix: &'a Matrix,
    /// See [`Elimination::starts`].
    starts: &'a [usize],
    /// Halves have at least this many unknowns.
    least_half: usize,
    fork: &'a dyn Fork,
}

/// Fronts that are factored.
struct Factored<const SIDES: usize> {
    parts: Vec<Part<SIDES>>,
    /// What the last front leaves to the next one.
    remainder: [Vec<f64>; SIDES],
    /// The place of each unknown in the last front; others have any place.
    slots: Vec<usize>,
}

/// The sizes of a front, in tiles.
#[derive(Debug, Clone, Copy)]
struct Shape {
    /// Rows and columns of the pivots.
    own: usize,
    /// Rows below them.
    rest: usize,
}

/// Number of tiles of a triangle, diagonal included.
const fn triangle(side: usize) -> usize {
    side * (side + 1) / 2
}

impl Shape {
    fn of<const COMPONENTS: usize>(elimination: &Elimination, front: usize) -> Self {
        let tiles = |points: usize| (points * COMPONENTS).div_ceil(SIDE);
        Self { own: tiles(elimination.own(front).len()), rest: tiles(elimination.rows(front).len()) }
    }

    /// The first tile of a row in the factor.
    fn row(self, row: usize) -> usize {
        if row < self.own { triangle(row) } else { triangle(self.own) + (row - self.own) * self.own }
    }

    /// Numbers in the factor.
    fn factor_len(self) -> usize {
        self.row(self.own + self.rest) * AREA
    }

    /// Numbers in the remainder.
    fn remainder_len(self) -> usize {
        triangle(self.rest) * AREA
    }

    /// The place of a row of numbers and its length, in the factor; columns are four numbers apart.
    fn factor_row(self, row: usize) -> usize {
        self.row(row / SIDE) * AREA + row % SIDE
    }

    /// The same in the remainder, for rows below the pivots.
    fn remainder_row(self, row: usize) -> usize {
        let row = row - self.own * SIDE;
        triangle(row / SIDE) * AREA + row % SIDE
    }
}

impl<'a, const COMPONENTS: usize, const SIDES: usize> Factor<'a, COMPONENTS, SIDES> {
    /// Factors a matrix; `fork` may factor its halves at once.
    ///
    /// # Errors
    /// See [`FactorError`].
    pub(crate) fn new(
        elimination: &'a Elimination,
        matrix: &(impl Couplings<COMPONENTS, SIDES> + Sync),
        fork: &dyn Fork,
    ) -> Result<Self, FactorError> {
        let unknowns = elimination.len() * COMPONENTS;
        // With more components, each unknown is coupled to as many more others.
        let least_half = (LEAST_HALF / COMPONENTS).max(unknowns / SMALLEST_SHARE);
        Self::with_least_half(elimination, matrix, least_half, fork)
    }

    fn with_least_half(
        elimination: &'a Elimination,
        matrix: &(impl Couplings<COMPONENTS, SIDES> + Sync),
        least_half: usize,
        fork: &dyn Fork,
    ) -> Result<Self, FactorError> {
        let starts = elimination.starts().ok_or(FactorError::Memory)?;
        let task = Task { elimination, matrix, starts: &starts, least_half, fork };
        let fronts = 0..elimination.fronts();
        let Some(division) = task.divide(&fronts, COMPONENTS) else {
            let all = task.in_turn(fronts)?;
            return Ok(Self { elimination, halves: [Vec::new(), Vec::new()], top: all.parts });
        };
        let (halves, top) = task.divided(division)?;
        Ok(Self { elimination, halves, top: top.parts })
    }

    /// Replaces a right-hand side, in the order of the elimination, by the solution. `fork` may solve the halves at once.
    pub(crate) fn solve(&self, right: &mut [[f64; COMPONENTS]], fork: &dyn Fork) {
        let right = right.as_flattened_mut();
        let [low_parts, high_parts] = &self.halves;
        let end_of = |parts: &[Part<SIDES>]| {
            parts.last().map_or(0, |part| self.elimination.own(part.fronts.end - 1).end * COMPONENTS)
        };
        let (middle, top) = (end_of(low_parts), end_of(high_parts));
        let (halves, above) = right.split_at_mut(top);
        let (low, high) = halves.split_at_mut(middle);
        let mut above_high = vec![0.0; above.len()];
        let all = top + above.len();
        join(
            fork,
            || self.forward(low_parts, Values { start: 0, own: low, top, above: &mut *above }),
            || self.forward(high_parts, Values { start: middle, own: high, top, above: &mut above_high }),
        );
        above.iter_mut().zip(above_high).for_each(|(value, part)| *value += part);
        self.forward(&self.top, Values { start: top, own: &mut *above, top: all, above: &mut [] });
        self.backward(&self.top, Values { start: top, own: &mut *above, top: all, above: &[] });
        let above = &*above;
        join(
            fork,
            || self.backward(low_parts, Values { start: 0, own: low, top, above }),
            || self.backward(high_parts, Values { start: middle, own: high, top, above }),
        );
    }

    fn forward(&self, parts: &[Part<SIDES>], mut right: Values<'_, &mut [f64]>) {
        let mut values = Vec::new();
        for part in parts {
            let mut rest = &part.sides[0][..];
            for front in part.fronts.clone() {
                let shape = Shape::of::<COMPONENTS>(self.elimination, front);
                let (factor, after) = rest.split_at(shape.factor_len());
                rest = after;
                self.forward_front(front, shape, factor, &mut right, &mut values);
            }
        }
    }

    fn forward_front(
        &self,
        front: usize,
        shape: Shape,
        factor: &[f64],
        right: &mut Values<'_, &mut [f64]>,
        values: &mut Vec<f64>,
    ) {
        let own = self.own(front, right.start);
        values.clear();
        values.extend_from_slice(&right.own[own.clone()]);
        values.resize(shape.own * SIDE, 0.0);
        for row in 0..shape.own {
            let (before, from) = values.split_at_mut(row * SIDE);
            let at = shape.row(row) * AREA;
            let sum = product(&factor[at..at + row * AREA], before);
            let tile = &factor[at + row * AREA..][..AREA];
            for column in 0..SIDE {
                let done: f64 = (0..column).map(|other| tile[other * SIDE + column] * from[other]).sum();
                from[column] = (from[column] - sum[column] - done) * tile[column * SIDE + column];
            }
        }
        let len = own.len();
        right.own[own].copy_from_slice(&values[..len]);
        let mut below = self.below(front);
        for row in shape.own..shape.own + shape.rest {
            let at = shape.row(row) * AREA;
            let sum = product(&factor[at..at + shape.own * AREA], values);
            for (sum, at) in sum.iter().zip(&mut below) {
                let value = match at.checked_sub(right.top) {
                    Some(above) => &mut right.above[above],
                    None => &mut right.own[at - right.start],
                };
                *value -= sum;
            }
        }
    }

    fn backward(&self, parts: &[Part<SIDES>], mut right: Values<'_, &[f64]>) {
        let mut values = Vec::new();
        for part in parts.iter().rev() {
            let mut rest = &part.sides[SIDES - 1][..];
            for front in part.fronts.clone().rev() {
                let shape = Shape::of::<COMPONENTS>(self.elimination, front);
                let (before, factor) = rest.split_at(rest.len() - shape.factor_len());
                rest = before;
                self.backward_front(front, shape, factor, &mut right, &mut values);
            }
        }
    }

    fn backward_front(
        &self,
        front: usize,
        shape: Shape,
        factor: &[f64],
        right: &mut Values<'_, &[f64]>,
        values: &mut Vec<f64>,
    ) {
        let own = self.own(front, right.start);
        values.clear();
        values.extend_from_slice(&right.own[own.clone()]);
        values.resize(shape.own * SIDE, 0.0);
        let mut below = self.below(front);
        for row in shape.own..shape.own + shape.rest {
            let mut known = [0.0; SIDE];
            for (known, at) in known.iter_mut().zip(&mut below) {
                *known = match at.checked_sub(right.top) {
                    Some(above) => right.above[above],
                    None => right.own[at - right.start],
                };
            }
            let at = shape.row(row) * AREA;
            subtract_transposed(&factor[at..at + shape.own * AREA], &known, values);
        }
        for row in (0..shape.own).rev() {
            let at = shape.row(row) * AREA;
            let tile = &factor[at + row * AREA..][..AREA];
            let (before, from) = values.split_at_mut(row * SIDE);
            for column in (0..SIDE).rev() {
                let done: f64 =
                    (column + 1..SIDE).map(|other| tile[column * SIDE + other] * from[other]).sum();
                from[column] = (from[column] - done) * tile[column * SIDE + column];
            }
            let known = std::array::from_fn(|column| from[column]);
            subtract_transposed(&factor[at..at + row * AREA], &known, before);
        }
        let len = own.len();
        right.own[own].copy_from_slice(&values[..len]);
    }

    /// The places of the numbers that a front eliminates, among those from `start` on.
    fn own(&self, front: usize, start: usize) -> Range<usize> {
        let own = self.elimination.own(front);
        own.start * COMPONENTS - start..own.end * COMPONENTS - start
    }

    /// The later places to which a front is coupled.
    fn below(&self, front: usize) -> impl Iterator<Item = usize> {
        self.elimination.rows(front).iter().flat_map(|at| {
            let first = *at as usize * COMPONENTS;
            first..first + COMPONENTS
        })
    }
}

impl<Matrix> Task<'_, Matrix> {
    /// Factors some fronts, halves of them at once where they are large.
    fn factored<const COMPONENTS: usize, const SIDES: usize>(
        &self,
        fronts: Range<usize>,
    ) -> Result<Factored<SIDES>, FactorError>
    where
        Matrix: Couplings<COMPONENTS, SIDES> + Sync,
    {
        let Some(division) = self.divide(&fronts, COMPONENTS) else { return self.in_turn(fronts) };
        let ([low, high], mut top) = self.divided(division)?;
        top.parts = low.into_iter().chain(high).chain(top.parts).collect();
        Ok(top)
    }

    /// Two halves of some fronts that are not coupled, and the front to which both are added, if there is one; `None` where there are
    /// no halves that are large enough.
    fn divide(&self, fronts: &Range<usize>, components: usize) -> Option<[Range<usize>; 3]> {
        let last = fronts.end.checked_sub(1).filter(|last| fronts.contains(last))?;
        let place = |front: usize| self.elimination.own(front).end;
        let (from, to) = (self.elimination.own(fronts.start).start, place(last));
        let [middle, top] = if self.starts[last] == fronts.start {
            // Each child ends where the next one starts.
            let is_divided = self.elimination.children(last) == 2;
            is_divided.then(|| [self.starts[last - 1], last])?
        } else {
            let roots = std::iter::successors(Some(last), |&root| {
                self.starts[root].checked_sub(1).filter(|root| fronts.contains(root))
            });
            let starts = roots.map(|root| self.starts[root]).filter(|&start| start > fronts.start);
            let middle =
                starts.min_by_key(|&start| (place(start - 1) - from).abs_diff(to - place(start - 1)))?;
            [middle, fronts.end]
        };
        let halves = [fronts.start..middle, middle..top];
        let unknowns =
            |half: &Range<usize>| (place(half.end - 1) - self.elimination.own(half.start).start) * components;
        let [low, high] = halves;
        let are_large = unknowns(&low).min(unknowns(&high)) >= self.least_half;
        are_large.then_some([low, high, top..fronts.end])
    }

    /// Factors two halves and the front to which they are added, if there is one.
    fn divided<const COMPONENTS: usize, const SIDES: usize>(
        &self,
        [low, high, top]: [Range<usize>; 3],
    ) -> Result<([Vec<Part<SIDES>>; 2], Factored<SIDES>), FactorError>
    where
        Matrix: Couplings<COMPONENTS, SIDES> + Sync,
    {
        let children = [low.end - 1, high.end - 1];
        let (low, high) = join(self.fork, || self.factored(low), || self.factored(high));
        let (low, high) = (low?, high?);
        let mut slots = low.slots;
        if top.is_empty() {
            let remainder = [const { Vec::new() }; SIDES];
            return Ok(([low.parts, high.parts], Factored { parts: Vec::new(), remainder, slots }));
        }
        let shape = Shape::of::<COMPONENTS>(self.elimination, top.start);
        let mut sides = zeros(shape.factor_len())?;
        let mut remainder = zeros(shape.remainder_len())?;
        let of_children = [&low.remainder, &high.remainder];
        self.front(
            top.start,
            children.into_iter().zip(of_children.map(|of_child| of_child.each_ref().map(Vec::as_slice))),
            &mut slots,
            sides.each_mut().map(Vec::as_mut_slice),
            remainder.each_mut().map(Vec::as_mut_slice),
        )?;
        let parts = vec![Part { fronts: top, sides }];
        Ok(([low.parts, high.parts], Factored { parts, remainder, slots }))
    }

    /// Factors some fronts one after the other.
    fn in_turn<const COMPONENTS: usize, const SIDES: usize>(
        &self,
        fronts: Range<usize>,
    ) -> Result<Factored<SIDES>, FactorError>
    where
        Matrix: Couplings<COMPONENTS, SIDES>,
    {
        let elimination = self.elimination;
        let (in_factor, in_remainders) = numbers::<COMPONENTS>(elimination, fronts.clone())?;
        let mut sides = [const { Vec::new() }; SIDES];
        let mut remainders = [const { Vec::new() }; SIDES];
        for side in 0..SIDES {
            sides[side].try_reserve_exact(in_factor)?;
            remainders[side].try_reserve_exact(in_remainders)?;
        }
        let mut slots = filled(elimination.len(), 0).ok_or(FactorError::Memory)?;
        // The fronts whose remainders are not added yet, with the start of each.
        let mut waiting: Vec<(usize, usize)> = Vec::new();
        for front in fronts.clone() {
            let shape = Shape::of::<COMPONENTS>(elimination, front);
            let (start, end) = (sides[0].len(), remainders[0].len());
            for side in 0..SIDES {
                sides[side].resize(start + shape.factor_len(), 0.0);
                remainders[side].resize(end + shape.remainder_len(), 0.0);
            }
            let children = waiting.len() - elimination.children(front);
            let freed = waiting.get(children).map_or(end, |child| child.1);
            let mut before: [&[f64]; SIDES] = [&[]; SIDES];
            let mut after = remainders.each_mut().map(Vec::as_mut_slice);
            for (before, after) in before.iter_mut().zip(&mut after) {
                let (old, new) = std::mem::take(after).split_at_mut(end);
                (*before, *after) = (old, new);
            }
            let added = waiting.drain(children..).map(|(child, at)| (child, before.map(|side| &side[at..])));
            self.front(front, added, &mut slots, sides.each_mut().map(|side| &mut side[start..]), after)?;
            for side in &mut remainders {
                side.copy_within(end.., freed);
                side.truncate(freed + shape.remainder_len());
            }
            waiting.push((front, freed));
        }
        remainders.iter_mut().for_each(Vec::shrink_to_fit);
        let parts = if fronts.is_empty() { Vec::new() } else { vec![Part { fronts, sides }] };
        Ok(Factored { parts, remainder: remainders, slots })
    }

    /// Factors a front: the values of the matrix in its columns and the remainders of its children.
    fn front<'r, const COMPONENTS: usize, const SIDES: usize>(
        &self,
        front: usize,
        children: impl Iterator<Item = (usize, [&'r [f64]; SIDES])>,
        slots: &mut [usize],
        mut factors: [&mut [f64]; SIDES],
        mut remainders: [&mut [f64]; SIDES],
    ) -> Result<(), FactorError>
    where
        Matrix: Couplings<COMPONENTS, SIDES>,
    {
        let elimination = self.elimination;
        let shape = Shape::of::<COMPONENTS>(elimination, front);
        elimination.own(front).enumerate().for_each(|(index, at)| slots[at] = index * COMPONENTS);
        let rows = elimination.rows(front).iter().enumerate();
        rows.for_each(|(index, at)| slots[*at as usize] = shape.own * SIDE + index * COMPONENTS);
        self.assemble(front, shape, slots, &mut factors);
        for (child, of_child) in children {
            let places = places::<COMPONENTS>(elimination, child, slots);
            for side in 0..SIDES {
                add_remainder(of_child[side], &places, shape, factors[side], remainders[side]);
            }
        }
        eliminate(shape, &mut factors, &mut remainders)
    }

    /// The values of the matrix in the columns of a front.
    fn assemble<const COMPONENTS: usize, const SIDES: usize>(
        &self,
        front: usize,
        shape: Shape,
        slots: &[usize],
        factors: &mut [&mut [f64]; SIDES],
    ) where
        Matrix: Couplings<COMPONENTS, SIDES>,
    {
        let elimination = self.elimination;
        let own = elimination.own(front);
        for position in own.clone() {
            let point = elimination.order()[position] as usize;
            let column = slots[position];
            self.matrix.each(point, |other, values| {
                let Some(at) = elimination.position(other).filter(|at| *at >= position) else { return };
                for down in 0..COMPONENTS {
                    let row = shape.factor_row(slots[at] + down);
                    for across in 0..if at == position { down + 1 } else { COMPONENTS } {
                        for side in 0..SIDES {
                            factors[side][row + (column + across) * SIDE] += values[side][down][across];
                        }
                    }
                }
            });
        }
        // Unused columns of the last tile.
        for slot in own.len() * COMPONENTS..shape.own * SIDE {
            factors.iter_mut().for_each(|factor| factor[shape.factor_row(slot) + slot * SIDE] = 1.0);
        }
    }
}

/// Numbers of each side of the factor of some fronts, and of the remainders that exist at the same time.
fn numbers<const COMPONENTS: usize>(
    elimination: &Elimination,
    fronts: Range<usize>,
) -> Result<(usize, usize), FactorError> {
    let (mut in_factor, mut used, mut most) = (0usize, 0usize, 0usize);
    let mut waiting: Vec<usize> = Vec::new();
    for front in fronts {
        let shape = Shape::of::<COMPONENTS>(elimination, front);
        in_factor = in_factor.checked_add(shape.factor_len()).ok_or(FactorError::Memory)?;
        used = used.checked_add(shape.remainder_len()).ok_or(FactorError::Memory)?;
        most = most.max(used);
        let children = waiting.drain(waiting.len() - elimination.children(front)..);
        used -= children.sum::<usize>();
        waiting.push(shape.remainder_len());
    }
    Ok((in_factor, most))
}

/// Zeros for each side; an error when there is not enough memory.
fn zeros<const SIDES: usize>(len: usize) -> Result<[Vec<f64>; SIDES], FactorError> {
    let mut sides = [const { Vec::new() }; SIDES];
    for side in &mut sides {
        *side = filled(len, 0.0).ok_or(FactorError::Memory)?;
    }
    Ok(sides)
}

/// A row of tiles times a vector.
fn product(tiles: &[f64], vector: &[f64]) -> [f64; SIDE] {
    let mut sum = [0.0; SIDE];
    for (column, value) in tiles.as_chunks::<SIDE>().0.iter().zip(vector) {
        for row in 0..SIDE {
            sum[row] += column[row] * value;
        }
    }
    sum
}

/// Subtracts a transposed row of tiles times a vector.
fn subtract_transposed(tiles: &[f64], vector: &[f64; SIDE], from: &mut [f64]) {
    for (column, from) in tiles.as_chunks::<SIDE>().0.iter().zip(from) {
        *from -=
            (column[0] * vector[0] + column[1] * vector[1]) + (column[2] * vector[2] + column[3] * vector[3]);
    }
}

/// Where the rows of a child's remainder are in the front that they are added to.
fn places<const COMPONENTS: usize>(elimination: &Elimination, child: usize, slots: &[usize]) -> Vec<usize> {
    let rows = elimination.rows(child).iter();
    rows.flat_map(|at| slots[*at as usize]..slots[*at as usize] + COMPONENTS).collect()
}

/// Adds a child's remainder to a front.
fn add_remainder(child: &[f64], places: &[usize], shape: Shape, factor: &mut [f64], remainder: &mut [f64]) {
    let pivots = shape.own * SIDE;
    let in_factor = places.partition_point(|place| *place < pivots);
    for (index, rows) in places.chunks(SIDE).enumerate() {
        let tiles = &child[triangle(index) * AREA..][..(index + 1) * AREA];
        for (row, place) in rows.iter().enumerate() {
            let count = index * SIDE + row + 1;
            let values = tiles.iter().skip(row).step_by(SIDE).zip(&places[..count]);
            let to = &mut factor[shape.factor_row(*place)..];
            values.clone().take(in_factor).for_each(|(value, column)| to[column * SIDE] += value);
            if count > in_factor {
                let to = &mut remainder[shape.remainder_row(*place)..];
                values.skip(in_factor).for_each(|(value, column)| to[(column - pivots) * SIDE] += value);
            }
        }
    }
}

/// Factors the pivots' columns of a front and subtracts their products from its remainder.
#[multiversion(targets("x86_64+avx2"))]
fn eliminate<const SIDES: usize>(
    shape: Shape,
    factors: &mut [&mut [f64]; SIDES],
    remainders: &mut [&mut [f64]; SIDES],
) -> Result<(), FactorError> {
    let rows = shape.own + shape.rest;
    let mut divisors = [[[0.0; AREA]; PANEL]; SIDES];
    for first in (0..shape.own).step_by(PANEL) {
        let end = (first + PANEL).min(shape.own);
        for row in first..rows {
            for column in first..end.min(row) {
                for side in 0..SIDES {
                    let (tile, left, right) = operands(factors, side, shape, [row, column], first..column);
                    subtract_product(tile, left, right);
                    divide_tile(tile, &divisors[SIDES - 1 - side][column - first]);
                }
            }
            if row < end {
                for side in 0..SIDES {
                    let (tile, left, right) = operands(factors, side, shape, [row, row], first..row);
                    subtract_product(tile, left, right);
                    divisors[side][row - first] = *tile;
                }
                let mut tiles: [[f64; AREA]; SIDES] = std::array::from_fn(|side| divisors[side][row - first]);
                factor_tile(&mut tiles)?;
                for side in 0..SIDES {
                    divisors[side][row - first] = tiles[side];
                    *operands(factors, side, shape, [row, row], first..row).0 = tiles[side];
                }
            }
        }
        for block in (end..rows).step_by(BLOCK) {
            for row in block..rows {
                let columns = block..(block + BLOCK).min(row + 1);
                let in_factor = columns.end.min(shape.own);
                for side in 0..SIDES {
                    for column in columns.start..in_factor {
                        let (tile, left, right) = operands(factors, side, shape, [row, column], first..end);
                        subtract_product(tile, left, right);
                    }
                    if row < shape.own {
                        continue;
                    }
                    let part = |side: usize, row: usize| {
                        let start = shape.row(row) * AREA;
                        &factors[side][start + first * AREA..start + end * AREA]
                    };
                    let left = part(side, row);
                    let start = triangle(row - shape.own) * AREA;
                    let (tiles, _) = remainders[side][start..].as_chunks_mut::<AREA>();
                    for column in columns.start.max(in_factor)..columns.end {
                        subtract_product(
                            &mut tiles[column - shape.own],
                            left,
                            part(SIDES - 1 - side, column),
                        );
                    }
                }
            }
        }
    }
    Ok(())
}

/// A tile of the factor with the rows of tiles whose product is subtracted from it, over some columns: its own row, and
/// the row of the other side that is as far down as the tile is to the right.
#[inline(always)]
fn operands<'a, const SIDES: usize>(
    factors: &'a mut [&mut [f64]; SIDES],
    side: usize,
    shape: Shape,
    [row, column]: [usize; 2],
    over: Range<usize>,
) -> (&'a mut [f64; AREA], &'a [f64], &'a [f64]) {
    let [start, across] = [row, column].map(|row| shape.row(row) * AREA);
    let across = across + over.start * AREA..across + over.end * AREA;
    let (this, other) = if SIDES == 1 {
        let (before, this) = factors[0].split_at_mut(start);
        (this, &*before)
    } else {
        let (first, second) = factors.split_at_mut(1);
        let (this, other) = if side == 0 { (&mut first[0], &second[0]) } else { (&mut second[0], &first[0]) };
        (&mut this[start..], &**other)
    };
    let (left, tile) = this.split_at_mut(column * AREA);
    let left = &left[over.start * AREA..over.end * AREA];
    // On the diagonal, the two rows of a single side are the same.
    let right = if SIDES == 1 && row == column { left } else { &other[across] };
    (&mut tile.as_chunks_mut().0[0], left, right)
}

/// Subtracts a row of tiles times another, transposed row of tiles from a tile.
#[inline(always)]
fn subtract_product(tile: &mut [f64; AREA], left: &[f64], right: &[f64]) {
    let mut sums = [[0.0; SIDE]; SIDE];
    for (left, right) in left.as_chunks::<SIDE>().0.iter().zip(right.as_chunks::<SIDE>().0) {
        for column in 0..SIDE {
            for row in 0..SIDE {
                sums[column][row] += left[row] * right[column];
            }
        }
    }
    tile.iter_mut().zip(sums.as_flattened()).for_each(|(value, sum)| *value -= sum);
}

/// Factors a tile on the diagonal.
fn factor_tile<const SIDES: usize>(tiles: &mut [[f64; AREA]; SIDES]) -> Result<(), FactorError> {
    for pivot in 0..SIDE {
        let root = tiles[0][pivot * SIDE + pivot].sqrt();
        // Also for NaN and for infinite pivots.
        if !(root > 0.0 && root < f64::INFINITY) {
            return Err(FactorError::Pivot);
        }
        for tile in tiles.iter_mut() {
            tile[pivot * SIDE + pivot] = 1.0 / root;
            (pivot + 1..SIDE).for_each(|row| tile[pivot * SIDE + row] *= 1.0 / root);
        }
        for column in pivot + 1..SIDE {
            for row in column..SIDE {
                let changes: [f64; SIDES] = std::array::from_fn(|side| {
                    tiles[side][pivot * SIDE + row] * tiles[SIDES - 1 - side][pivot * SIDE + column]
                });
                (0..SIDES).for_each(|side| tiles[side][column * SIDE + row] -= changes[side]);
            }
        }
    }
    Ok(())
}

/// Divides a tile by the transpose of a factored tile of the diagonal.
#[inline(always)]
fn divide_tile(tile: &mut [f64; AREA], divisor: &[f64; AREA]) {
    for column in 0..SIDE {
        for before in 0..column {
            for row in 0..SIDE {
                tile[column * SIDE + row] -= tile[before * SIDE + row] * divisor[before * SIDE + column];
            }
        }
        for row in 0..SIDE {
            tile[column * SIDE + row] *= divisor[column * SIDE + column];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fork::InTurn;
    use nalgebra::{DMatrix, DVector};

    /// A dense matrix over the points of a grid.
    struct Dense(DMatrix<f64>);

    impl<const COMPONENTS: usize, const SIDES: usize> Couplings<COMPONENTS, SIDES> for Dense {
        fn each(&self, point: usize, mut add: impl FnMut(usize, &[[[f64; COMPONENTS]; COMPONENTS]; SIDES])) {
            for other in 0..self.0.nrows() / COMPONENTS {
                let value = |down: usize, across: usize, side: usize| {
                    let at = [other * COMPONENTS + down, point * COMPONENTS + across];
                    self.0[(at[side], at[1 - side])]
                };
                let block: [[[f64; COMPONENTS]; COMPONENTS]; SIDES] = std::array::from_fn(|side| {
                    std::array::from_fn(|down| std::array::from_fn(|across| value(down, across, side)))
                });
                if block.as_flattened().as_flattened().iter().any(|value| *value != 0.0) {
                    add(other, &block);
                }
            }
        }
    }

    struct Grid {
        columns: usize,
        rows: usize,
        reach: usize,
    }

    impl Grid {
        fn is_near(&self, a: usize, b: usize) -> bool {
            (a % self.columns).abs_diff(b % self.columns) <= self.reach
                && (a / self.columns).abs_diff(b / self.columns) <= self.reach
        }

        /// Random values within the reach, with a diagonal that dominates them.
        fn random<const COMPONENTS: usize>(&self, is_symmetric: bool) -> DMatrix<f64> {
            let unknowns = self.columns * self.rows * COMPONENTS;
            let mut state = 1u64;
            let mut matrix = DMatrix::from_fn(unknowns, unknowns, |row, column| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let is_near = self.is_near(row / COMPONENTS, column / COMPONENTS);
                if is_near { (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5 } else { 0.0 }
            });
            if is_symmetric {
                matrix = &matrix + matrix.transpose();
            }
            for row in 0..unknowns {
                matrix[(row, row)] = 0.1 + matrix.row(row).abs().sum().max(matrix.column(row).abs().sum());
            }
            matrix
        }

        /// Compares with a dense factor, with the unknowns that remain if some points are fixed.
        fn compare<const COMPONENTS: usize, const SIDES: usize>(&self, is_unknown: &dyn Fn(usize) -> bool) {
            let matrix = self.random::<COMPONENTS>(SIDES == 1);
            let size = (self.columns, self.rows);
            let elimination = Elimination::new(size, self.reach, is_unknown).unwrap();
            let unknowns: Vec<usize> = (0..matrix.nrows()).filter(|at| is_unknown(at / COMPONENTS)).collect();
            if unknowns.is_empty() {
                return;
            }
            let dense = DMatrix::from_fn(unknowns.len(), unknowns.len(), |row, column| {
                matrix[(unknowns[row], unknowns[column])]
            });
            let right = DVector::from_fn(unknowns.len(), |row, _| (unknowns[row] as f64).sin());
            let truth = if SIDES == 1 {
                dense.clone().cholesky().unwrap().solve(&right)
            } else {
                dense.lu().solve(&right).unwrap()
            };
            let scalars = |point: u32| std::array::from_fn(|at| point as usize * COMPONENTS + at);
            // As a whole, and in halves.
            for least_half in [usize::MAX, 20, 1] {
                let matrix = Dense(matrix.clone());
                let factor =
                    Factor::<COMPONENTS, SIDES>::with_least_half(&elimination, &matrix, least_half, &InTurn);
                let order = elimination.order().iter();
                let mut found: Vec<[f64; COMPONENTS]> =
                    order.map(|point| scalars(*point).map(|at| (at as f64).sin())).collect();
                factor.unwrap().solve(&mut found, &InTurn);
                for (row, value) in unknowns.iter().zip(&truth) {
                    let at = elimination.position(row / COMPONENTS).unwrap();
                    let found = found[at][row % COMPONENTS];
                    assert!(
                        (found - value).abs() < 1e-12,
                        "{found} for {value}, {COMPONENTS} {SIDES} {least_half}"
                    );
                }
            }
        }
    }

    #[test]
    fn solutions_are_those_of_dense_factors() {
        let all = |_: usize| true;
        let some = |point: usize| point * 7919 % 5 > 1;
        let half = |point: usize| point % 12 < 6;
        let two_parts = |point: usize| !(3..8).contains(&(point % 12));
        for (columns, rows) in [(12, 13), (1, 1), (1, 40), (40, 1), (3, 30), (25, 5), (2, 2)] {
            for is_unknown in [&all as &dyn Fn(usize) -> bool, &some, &half, &two_parts] {
                let grid = |reach: usize| Grid { columns, rows, reach };
                grid(3).compare::<1, 1>(is_unknown);
                grid(3).compare::<2, 1>(is_unknown);
                grid(3).compare::<3, 1>(is_unknown);
                grid(1).compare::<1, 2>(is_unknown);
                grid(2).compare::<2, 2>(is_unknown);
            }
        }
    }

    /// Coupled to the next points in the row and in the column.
    struct Laplace {
        columns: usize,
        rows: usize,
        middle: f64,
    }

    impl Couplings<1, 1> for Laplace {
        fn each(&self, point: usize, mut add: impl FnMut(usize, &[[[f64; 1]; 1]; 1])) {
            let (column, row) = (point % self.columns, point / self.columns);
            add(point, &[[[self.middle]]]);
            for (is_inside, other) in [
                (column > 0, point.wrapping_sub(1)),
                (column + 1 < self.columns, point + 1),
                (row > 0, point.wrapping_sub(self.columns)),
                (row + 1 < self.rows, point + self.columns),
            ] {
                if is_inside {
                    add(other, &[[[-1.0]]]);
                }
            }
        }
    }

    /// The difference equation of Laplace has the eigenvectors sin(jπx) sin(kπy), also on a grid that needs several
    /// panels and blocks.
    #[test]
    fn eigenvectors_of_the_laplacian_are_multiplied_by_their_eigenvalue() {
        use std::f64::consts::PI;
        for (columns, rows) in [(130, 120), (1000, 3), (1, 7)] {
            let elimination = Elimination::new((columns, rows), 3, |_| true).unwrap();
            let factor = Factor::new(&elimination, &Laplace { columns, rows, middle: 4.0 }, &InTurn).unwrap();
            let (u, v) = (2.0 * PI / (columns + 1) as f64, 3.0 * PI / (rows + 1) as f64);
            let wave = |point: u32| {
                let (column, row) = (point as usize % columns + 1, point as usize / columns + 1);
                (u * column as f64).sin() * (v * row as f64).sin()
            };
            let mut found: Vec<[f64; 1]> = elimination.order().iter().map(|point| [wave(*point)]).collect();
            factor.solve(&mut found, &InTurn);
            let eigenvalue = 4.0 - 2.0 * u.cos() - 2.0 * v.cos();
            for (point, [value]) in elimination.order().iter().zip(found) {
                assert!((value * eigenvalue - wave(*point)).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_is_refused() {
        for middle in [0.0, 1.0, 3.9, -4.0, f64::NAN, f64::INFINITY] {
            let (columns, rows) = (31, 30);
            let elimination = Elimination::new((columns, rows), 3, |_| true).unwrap();
            let found = Factor::new(&elimination, &Laplace { columns, rows, middle }, &InTurn);
            assert_eq!(found.err(), Some(FactorError::Pivot), "{middle}");
        }
    }

    #[test]
    fn no_unknowns_have_an_empty_solution() {
        let elimination = Elimination::new((5, 5), 3, |_| false).unwrap();
        let factor =
            Factor::new(&elimination, &Laplace { columns: 5, rows: 5, middle: 4.0 }, &InTurn).unwrap();
        factor.solve(&mut [], &InTurn);
    }
}
