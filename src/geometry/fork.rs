//! Work in two halves that do not depend on each other. Who does them, and whether at once, is decided outside: the result is the
//! same.

use std::fmt::Debug;
use std::ops::Range;

/// Fewer triangles, vertices or nodes are processed faster than they are shared among threads.
const LEAST_AT_ONCE: usize = 1_000;

/// The same limit for looks ahead, which take longer.
const LEAST_LOOKS: usize = 16;
/// At most this many things are looked at ahead.
const MOST_AHEAD: usize = 1_024;
/// At most one in this many looks ahead may be in vain.
const MOST_VAIN: usize = 8;

/// Does two pieces of work.
pub trait Fork: Sync + Debug {
    /// Starts work that forks many times: where its halves are done, if that is elsewhere.
    fn start(&self, work: &mut (dyn FnMut() + Send)) {
        work();
    }

    /// Does both, one after the other or at once.
    fn both(&self, one: &mut (dyn FnMut() + Send), other: &mut (dyn FnMut() + Send));
}

/// Does one piece of work after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InTurn;

impl Fork for InTurn {
    fn both(&self, one: &mut (dyn FnMut() + Send), other: &mut (dyn FnMut() + Send)) {
        one();
        other();
    }
}

/// The result of work that forks many times.
///
/// # Panics
/// Never, if `fork` does the work.
pub(crate) fn start<T: Send>(fork: &dyn Fork, work: impl FnOnce() -> T + Send) -> T {
    let (mut work, mut result) = (Some(work), None);
    fork.start(&mut || result = work.take().map(|work| work()));
    result.expect("a fork does the work")
}

/// The results of two pieces of work.
///
/// # Panics
/// Never, if `fork` does both.
pub(crate) fn join<A: Send, B: Send>(
    fork: &dyn Fork,
    one: impl FnOnce() -> A + Send,
    other: impl FnOnce() -> B + Send,
) -> (A, B) {
    let (mut one, mut other) = (Some(one), Some(other));
    let (mut of_one, mut of_other) = (None, None);
    fork.both(&mut || of_one = one.take().map(|work| work()), &mut || {
        of_other = other.take().map(|work| work())
    });
    (of_one.expect("a fork does the first piece"), of_other.expect("a fork does the second piece"))
}

/// Works on each value of a list, which `work` is given with its index.
pub(crate) fn for_each<T: Send>(fork: &dyn Fork, list: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
    fn halves<T: Send>(
        fork: &dyn Fork,
        start: usize,
        list: &mut [T],
        work: &(impl Fn(usize, &mut T) + Sync),
    ) {
        if list.len() < 2 * LEAST_AT_ONCE {
            return (start..).zip(list).for_each(|(index, value)| work(index, value));
        }
        let middle = list.len() / 2;
        let (one, other) = list.split_at_mut(middle);
        join(fork, || halves(fork, start, one, work), || halves(fork, start + middle, other, work));
    }
    halves(fork, 0, list, &work);
}

/// The result of `work` for each number below `count`.
pub(crate) fn mapped<T: Clone + Default + Send>(
    fork: &dyn Fork,
    count: usize,
    work: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let mut results = vec![T::default(); count];
    for_each(fork, &mut results, |index, result| *result = work(index));
    results
}

/// The results of `work` for the numbers below `count`, in their order, without the numbers for which there
/// is none.
pub(crate) fn found<T: Send>(
    fork: &dyn Fork,
    count: usize,
    work: impl Fn(usize) -> Option<T> + Sync,
) -> Vec<T> {
    in_pieces(fork, 0..count, LEAST_AT_ONCE, &|range| range.filter_map(&work).collect())
}

/// The lists of `work` for pieces of a range with at least `least` numbers, one after the other.
pub(crate) fn in_pieces<T: Send>(
    fork: &dyn Fork,
    range: Range<usize>,
    least: usize,
    work: &(impl Fn(Range<usize>) -> Vec<T> + Sync),
) -> Vec<T> {
    if range.len() < 2 * least {
        return work(range);
    }
    let middle = range.start + range.len() / 2;
    let (mut one, mut other) = join(
        fork,
        || in_pieces(fork, range.start..middle, least, work),
        || in_pieces(fork, middle..range.end, least, work),
    );
    one.append(&mut other);
    one
}

/// Processes the `things` that are open, in their order, until `take` returns false. `look` reads what it
/// needs of a thing.
///
/// Several things are looked at ahead. Their number grows as long as few of them are closed when it is their
/// turn. So the state that `look` reads must not change, and a closed thing must not open again.
pub(crate) fn look_ahead<State: Sync, Seen: Send>(
    fork: &dyn Fork,
    things: &[usize],
    state: &mut State,
    is_open: impl Fn(&State, usize) -> bool,
    look: impl Fn(&State, usize) -> Seen + Sync,
    mut take: impl FnMut(&mut State, usize, Seen) -> bool,
) {
    let (mut ahead, mut rest) = (1, things);
    while !rest.is_empty() {
        let mut chosen = Vec::new();
        while let Some((&thing, after)) = rest.split_first().filter(|_| chosen.len() < ahead) {
            rest = after;
            if is_open(state, thing) {
                chosen.push(thing);
            }
        }
        let look_at = |range: Range<usize>| chosen[range].iter().map(|&thing| look(state, thing)).collect();
        let seen: Vec<Seen> = in_pieces(fork, 0..chosen.len(), LEAST_LOOKS, &look_at);
        let mut closed = 0;
        for (&thing, seen) in chosen.iter().zip(seen) {
            if !is_open(state, thing) {
                closed += 1;
            } else if !take(state, thing, seen) {
                return;
            }
        }
        let is_vain = MOST_VAIN * closed > chosen.len();
        ahead = if is_vain { ahead.div_ceil(2) } else { (2 * ahead).min(MOST_AHEAD) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::mapping::isometric::IsometricOptions;
    use crate::geometry::mapping::{LengthTrueMap, Method};
    use crate::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
    use crate::geometry::shapes;
    use crate::geometry::space::{FlatPoint, View};
    use crate::geometry::surface::fit::{FitOptions, FittedSurface};

    /// Does the second piece of work first.
    #[derive(Debug)]
    struct OtherFirst;

    impl Fork for OtherFirst {
        fn both(&self, one: &mut (dyn FnMut() + Send), other: &mut (dyn FnMut() + Send)) {
            other();
            one();
        }
    }

    #[test]
    fn pieces_come_in_the_order_of_their_numbers_whoever_works_first() {
        let count = 5 * LEAST_AT_ONCE + 3;
        for fork in [&InTurn as &dyn Fork, &OtherFirst] {
            let odd = found(fork, count, |number| (number % 2 == 1).then_some(number));
            assert!(odd.into_iter().eq((0..count).filter(|number| number % 2 == 1)));
            assert!(
                mapped(fork, count, |number| 3 * number).into_iter().eq((0..count).map(|number| 3 * number))
            );
        }
    }

    #[test]
    fn looks_ahead_are_taken_as_if_each_thing_was_looked_at_in_its_turn() {
        // A thing closes its next multiples, as the facets of a cylinder are found from one of them.
        let things: Vec<usize> = (2..3_000).collect();
        let mut open = vec![true; 3_000];
        let mut expected = Vec::new();
        for &thing in &things {
            if open[thing] {
                expected.push((thing, 7 * thing));
                (2 * thing..3_000).step_by(thing).for_each(|multiple| open[multiple] = false);
            }
        }
        for (fork, last) in [(&InTurn as &dyn Fork, 3_000), (&OtherFirst, 3_000), (&OtherFirst, 1_000)] {
            let mut taken = Vec::new();
            look_ahead(
                fork,
                &things,
                &mut vec![true; 3_000],
                |open, thing| open[thing],
                |_, thing| 7 * thing,
                |open, thing, seen| {
                    if thing > last {
                        return false;
                    }
                    taken.push((thing, seen));
                    (2 * thing..3_000).step_by(thing).for_each(|multiple| open[multiple] = false);
                    true
                },
            );
            assert!(taken.iter().eq(expected.iter().filter(|(thing, _)| *thing <= last)));
        }
    }

    #[test]
    fn a_fit_does_not_depend_on_who_works_first() {
        let cylinder = |x: f64, _: f64| (30.0f64 * 30.0 - x * x).max(0.0).sqrt() - 30.0;
        for height in [shapes::sphere, shapes::mandarin, shapes::mouse, cylinder] {
            let mesh = shapes::graph(25.0, 0.6, height);
            let fit = |fork| {
                let part = FacingPart::with_fork(&mesh, &View::top(), fork);
                FittedSurface::of_part(&part, &FitOptions::default()).unwrap()
            };
            assert!(fit(&InTurn) == fit(&OtherFirst));
        }
    }

    /// Letters as wide as those of the other tests: lines and areas, on both halves of the cells.
    fn letters() -> Pattern {
        let square = |x: f64, y: f64, half: f64| {
            let corner = |right: f64, up: f64| FlatPoint::new(x + right * half, y + up * half);
            let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            let side = |side: usize| Segment::Line { from: corners[side], to: corners[(side + 1) % 4] };
            Path {
                layer: 0,
                color: Color::ByLayer,
                shape: Shape::Closed((0..4).map(side).collect()),
                region: None,
                source: Source::default(),
            }
        };
        let squares = (0..12).map(|letter| {
            let (column, row) = (f64::from(letter % 6), f64::from(letter / 6));
            square(5.0 * column - 12.0, 6.0 * row - 3.0, 1.5 + 0.1 * column)
        });
        Pattern { layers: vec![Layer { name: "0".into(), color: Color::Aci(7) }], paths: squares.collect() }
    }

    #[test]
    fn a_map_does_not_depend_on_who_works_first() {
        for height in [shapes::sphere, shapes::mandarin, shapes::mouse] {
            let mesh = shapes::graph(25.0, 0.6, height);
            let part = FacingPart::new(&mesh, &View::top());
            let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
            for options in [IsometricOptions::INK, IsometricOptions::UNIFORM, IsometricOptions::LENGTHS] {
                let (letters, method) = (letters(), Method::Isometric(options));
                let map = |fork| {
                    let anchor = FlatPoint::new(0.0, 0.0);
                    LengthTrueMap::find_with_fork(&surface, &letters, |_| true, anchor, &method, fork)
                };
                assert!(map(&InTurn).unwrap() == map(&OtherFirst).unwrap());
            }
        }
    }
}
