//! Which triangles, vertices and sides of a mesh are neighbours.

use nalgebra::{Point3, Vector3};

use super::disjoint_sets::DisjointSets;

/// Positions closer together than this, mm, are one place. Exporters repeat vertices at face borders and in
/// every facet. The copies differ because of 32-bit floats and because bodies are turned and moved: by
/// 0.00002 mm on a part of 200 mm. The limit is less than the last of three decimals.
pub(super) const WELD_DISTANCE: f64 = 5e-4;

/// Size of the cells in which positions are looked up, as a multiple of the distance. With this size, few
/// positions are near the border of a cell.
const CELL: f64 = 16.0;

/// The normal of a triangle whose smallest height is less than this, mm, is not reliable.
const SLIVER: f64 = 0.005;

/// Marks a missing index, such as that of a side or a vertex.
pub(crate) const NONE: u32 = u32::MAX;

/// For each position, the number of its place, from 0 in the order of first appearance. Positions closer together than
/// [`WELD_DISTANCE`] to the first one at a place share it, and so do places that a position between them connects.
pub(crate) fn weld(positions: &[Point3<f64>]) -> Vec<u32> {
    weld_within(positions, WELD_DISTANCE)
}

/// The same with another distance, mm.
pub(super) fn weld_within(positions: &[Point3<f64>], distance: f64) -> Vec<u32> {
    // Open addressing with at most half of the slots used; each slot holds the first item at its place. No two of these are closer
    // together than the distance, so that a cell has few of them however many positions are in it.
    let mut first = vec![NONE; (positions.len() * 2).next_power_of_two()];
    let slots = first.len();
    let mut numbers = vec![0; positions.len()];
    let mut count = 0;
    let mut connected: Vec<[u32; 2]> = Vec::new();
    for (index, here) in positions.iter().enumerate() {
        let cell = Cell::of(here, distance);
        let apart = |slot: usize| (positions[first[slot] as usize] - here).norm_squared();
        let number = |slot: usize| numbers[first[slot] as usize];
        if let Some(same) = chain(&first, cell.number).find(|&slot| apart(slot) == 0.0) {
            numbers[index] = number(same);
            continue;
        }
        let is_close = |&slot: &usize| apart(slot) < distance * distance;
        let place = {
            let chains = cell.within_reach().flat_map(|number| chain(&first, number));
            let mut close = chains.filter(is_close).map(number);
            let place = close.next();
            if let Some(place) = place {
                connected.extend(close.map(|other| [place, other]));
            }
            place
        };
        if let Some(place) = place {
            numbers[index] = place;
            continue;
        }
        let free = first_slot(cell.number, slots) + chain(&first, cell.number).count();
        first[free & (slots - 1)] = index as u32;
        numbers[index] = count;
        count += 1;
    }
    if !connected.is_empty() {
        let mut places = DisjointSets::new(count as usize);
        connected.into_iter().for_each(|[one, other]| places.join(one as usize, other as usize));
        let (places, _) = places.numbered();
        numbers.iter_mut().for_each(|number| *number = places[*number as usize]);
    }
    numbers
}

/// A cell of the grid in which positions are looked up.
struct Cell {
    number: Vector3<i64>,
    /// Along each axis, the step to the cell beside it that is within the distance; 0 if none is.
    beside: Vector3<i64>,
}

impl Cell {
    /// The cell with a position, for a distance in mm.
    fn of(position: &Point3<f64>, distance: f64) -> Self {
        let scaled = position.coords / (CELL * distance);
        let number = scaled.map(f64::floor);
        let beside = (scaled - number)
            .map(|share| i64::from(share > 1.0 - 1.0 / CELL) - i64::from(share < 1.0 / CELL));
        Self { number: number.map(|value| value as i64), beside }
    }

    /// The numbers of the cells with positions within the distance: this one, and those beside it.
    fn within_reach(&self) -> impl Iterator<Item = Vector3<i64>> {
        let step = |axis: usize| if self.beside[axis] == 0 { 0..1 } else { 0..2 };
        let steps =
            step(0).flat_map(move |x| step(1).flat_map(move |y| step(2).map(move |z| Vector3::new(x, y, z))));
        // Damaged files have positions beyond any cell.
        steps.map(|step| self.number.zip_map(&self.beside.component_mul(&step), i64::saturating_add))
    }
}

/// The slots with the items of a cell, among others.
fn chain(first: &[u32], cell: Vector3<i64>) -> impl Iterator<Item = usize> {
    let slots = first.len();
    let start = first_slot(cell, slots);
    (start..).map(move |slot| slot & (slots - 1)).take_while(|&slot| first[slot] != NONE)
}

/// Where the items of a cell begin.
fn first_slot(cell: Vector3<i64>, slots: usize) -> usize {
    (hash(cell.map(|value| value as u64).into()) >> 20) as usize & (slots - 1)
}

/// For each of `count` items, the number of its key, from 0 in the order of first appearance.
pub(crate) fn numbered(count: usize, key: impl Fn(usize) -> [i64; 3]) -> Vec<u32> {
    // Open addressing with at most half of the slots used; each slot holds the first item with its key.
    let slots = (count * 2).next_power_of_two();
    let mut first = vec![NONE; slots];
    let mut numbers = vec![0; count];
    let mut next = 0;
    for index in 0..count {
        let here = key(index);
        let mixed = hash(here.map(|value| value as u64));
        let mut slot = (mixed >> 20) as usize & (slots - 1);
        while first[slot] != NONE && key(first[slot] as usize) != here {
            slot = (slot + 1) & (slots - 1);
        }
        if first[slot] == NONE {
            first[slot] = index as u32;
            numbers[index] = next;
            next += 1;
        } else {
            numbers[index] = numbers[first[slot] as usize];
        }
    }
    numbers
}

/// A hash of three numbers, well mixed in its upper bits (Fibonacci hashing: D. E. Knuth, The Art of Computer
/// Programming 3, 1998, section 6.4).
fn hash(numbers: [u64; 3]) -> u64 {
    numbers
        .iter()
        .fold(0, |sum: u64, number| (sum.rotate_left(23) ^ number).wrapping_mul(0x9E37_79B9_7F4A_7C15))
}

/// For each side of each triangle (side 3·t + k runs from corner k to the next), the other side between the same two
/// vertices; [`NONE`] at a border, where more than two triangles meet, and at triangles with two corners at one place.
pub(crate) fn opposite_sides(triangles: &[[u32; 3]]) -> Vec<u32> {
    let count = triangles.iter().flatten().max().map_or(0, |last| *last as usize + 1);
    let ends = |side: usize| {
        let (from, to) = (triangles[side / 3][side % 3], triangles[side / 3][(side + 1) % 3]);
        // (side + 1) % 3 is the next corner, because 3·t is a multiple of 3.
        (from.min(to), from.max(to))
    };
    // A triangle with two corners at one place is between its neighbours, which are those of each other.
    let is_between = |[a, b, c]: [u32; 3]| a == b || b == c || c == a;
    let sides = || (0..triangles.len() * 3).filter(|side| !is_between(triangles[side / 3]));
    let (starts, by_lower) = grouped(count, || sides().map(|side| (ends(side).0, side as u32)));
    let mut opposite = vec![NONE; triangles.len() * 3];
    let mut around: Vec<(u32, u32)> = Vec::new();
    for vertex in 0..count {
        let here = &by_lower[starts[vertex] as usize..starts[vertex + 1] as usize];
        around.clear();
        around.extend(here.iter().map(|&side| (ends(side as usize).1, side)));
        around.sort_unstable();
        for run in around.chunk_by(|a, b| a.0 == b.0) {
            if let [(_, one), (_, two)] = *run {
                (opposite[one as usize], opposite[two as usize]) = (two, one);
            }
        }
    }
    opposite
}

/// Values by the group to which they belong, in the order in which `items` has them (group, value). Returns
/// the index at which the values of each of the `count` groups begin, with the number of values at the end;
/// and the values.
pub(super) fn grouped<Items: Iterator<Item = (u32, u32)>>(
    count: usize,
    items: impl Fn() -> Items,
) -> (Vec<u32>, Vec<u32>) {
    // Two ahead: while values are entered, each start is where the next value of the group before it belongs.
    let mut starts = vec![0u32; count + 2];
    items().for_each(|(group, _)| starts[group as usize + 2] += 1);
    (1..=count).for_each(|group| starts[group + 1] += starts[group]);
    let mut values = vec![0u32; starts[count + 1] as usize];
    items().for_each(|(group, value)| {
        let next = &mut starts[group as usize + 1];
        values[*next as usize] = value;
        *next += 1;
    });
    starts.truncate(count + 1);
    (starts, values)
}

/// Marks the vertices that can be reached from the marked ones over at most `sides` sides.
pub(super) fn spread(is_marked: &mut [bool], triangles: &[[u32; 3]], sides: usize) {
    for _ in 0..sides {
        let before = is_marked.to_vec();
        for corners in triangles.iter().filter(|corners| corners.iter().any(|&at| before[at as usize])) {
            corners.iter().for_each(|&at| is_marked[at as usize] = true);
        }
    }
}

/// For vertices, the vertices that share a side with them.
pub(super) struct Neighbours {
    starts: Vec<u32>,
    vertices: Vec<u32>,
}

impl Neighbours {
    /// Those of all `count` vertices.
    pub(super) fn of(triangles: &[[u32; 3]], count: usize) -> Self {
        Self::of_chosen(triangles, &vec![true; count])
    }

    /// Those of the chosen vertices, one flag for each; the others get none.
    pub(super) fn of_chosen(triangles: &[[u32; 3]], is_chosen: &[bool]) -> Self {
        let count = is_chosen.len();
        let chosen = |&corner: &u32| is_chosen[corner as usize];
        let sides = || {
            let near = triangles.iter().filter(|corners| corners.iter().any(chosen));
            let around = near.flat_map(|&[a, b, c]| [(a, b), (a, c), (b, c), (b, a), (c, a), (c, b)]);
            around.filter(|(from, _)| chosen(from))
        };
        let (mut starts, mut vertices) = grouped(count, sides);
        // Inner sides occur twice, once for each of their triangles.
        let mut kept = 0;
        for vertex in 0..count {
            let (first, end) =
                (std::mem::replace(&mut starts[vertex], kept) as usize, starts[vertex + 1] as usize);
            vertices[first..end].sort_unstable();
            for at in first..end {
                if at == first || vertices[at] != vertices[at - 1] {
                    vertices[kept as usize] = vertices[at];
                    kept += 1;
                }
            }
        }
        starts[count] = kept;
        vertices.truncate(kept as usize);
        vertices.shrink_to_fit();
        Self { starts, vertices }
    }

    /// The neighbours of a vertex, ascending.
    pub(super) fn of_vertex(&self, vertex: usize) -> &[u32] {
        &self.vertices[self.range(vertex)]
    }

    /// Where the neighbours of a vertex are among those of all vertices, one vertex after the other.
    pub(super) fn range(&self, vertex: usize) -> std::ops::Range<usize> {
        self.starts[vertex] as usize..self.starts[vertex + 1] as usize
    }
}

/// The middle of a triangle.
pub(super) fn middle(corners: [Point3<f64>; 3]) -> Point3<f64> {
    Point3::from(corners.iter().map(|corner| corner.coords).sum::<Vector3<f64>>() / 3.0)
}

pub(super) fn facet_normal([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vector3::zeros)
}

/// Twice the area of a triangle in the view, mm²; negative for one that runs clockwise.
pub(super) fn turn_in_view(corners: [Point3<f64>; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| corner.coords.xy());
    (b - a).perp(&(c - a))
}

/// How far a triangle reaches from one of its sides, mm.
pub(super) fn width(points: [Point3<f64>; 3], side: usize) -> f64 {
    let [from, to, far] = [0, 1, 2].map(|turn| points[(side + turn) % 3]);
    let along = to - from;
    along.cross(&(far - from)).norm() / along.norm()
}

/// The least height of a triangle, mm.
pub(super) fn least_width(points: [Point3<f64>; 3]) -> f64 {
    (0..3).map(|side| width(points, side)).fold(f64::INFINITY, f64::min)
}

/// The longest side of a triangle that is too narrow for a reliable normal, `None` for other triangles. Exporters
/// make such slivers where the vertices of two faces do not coincide.
pub(super) fn sliver_side(points: [Point3<f64>; 3]) -> Option<usize> {
    let [a, b, c] = points;
    let sides = [b - a, c - b, a - c].map(|side| side.norm_squared());
    let longest = (1..3).fold(0, |longest, side| if sides[side] > sides[longest] { side } else { longest });
    let doubled_area = (b - a).cross(&(c - a)).norm_squared();
    (doubled_area < SLIVER * SLIVER * sides[longest]).then_some(longest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_of_a_position_are_one_place_wherever_it_is() {
        // Nodes of a grid that are anywhere in the cells, each three times, a little apart.
        let nodes =
            (-40..40).flat_map(|x| (-3..3).map(move |y| Vector3::new(f64::from(x), f64::from(y), 0.5)));
        let nodes: Vec<Vector3<f64>> = nodes.map(|node| node * 0.12345).collect();
        let copies = [Vector3::zeros(), Vector3::new(-2e-4, 1e-4, 3e-4), Vector3::new(1e-4, -2e-4, 1e-4)];
        let positions: Vec<Point3<f64>> =
            copies.iter().flat_map(|copy| nodes.iter().map(move |node| Point3::from(node + copy))).collect();
        let expected: Vec<u32> = (0..3).flat_map(|_| 0..nodes.len() as u32).collect();
        assert_eq!(weld(&positions), expected);
    }

    #[test]
    fn positions_beyond_any_cell_have_places() {
        let along = [0.0, 1e300, -1e300, f64::MAX, f64::MIN, f64::INFINITY, 0.0];
        let positions: Vec<Point3<f64>> = along.map(|x| Point3::new(x, -x, 1.0)).into();
        let places = weld(&positions);
        assert!(places[0] == places[6] && !places[1..6].contains(&places[0]), "{places:?}");
    }

    #[test]
    fn places_are_apart_unless_positions_between_them_connect_them() {
        for first in [0.0, 0.123, 0.0079, 7.9999, -0.0001] {
            let along = |steps: &[f64]| -> Vec<u32> {
                let position = |step: &f64| Point3::new(1.0, first + step, 2.0);
                weld(&steps.iter().map(position).collect::<Vec<_>>())
            };
            assert_eq!(along(&[0.0, 8e-4]), [0, 1], "{first}");
            assert_eq!(along(&[0.0, 8e-4, 4e-4]), [0, 0, 0], "{first}");
            assert_eq!(along(&[0.0, 2e-3, 4e-4, 1e-3, 2e-3]), [0, 1, 0, 2, 1], "{first}");
        }
    }

    #[test]
    fn positions_that_are_crowded_have_few_places() {
        // A ball of the size of the distance, and one that is ten times as large: as of a part in a wrong unit.
        for (radius, most) in [(0.4 * WELD_DISTANCE, 1), (5.0 * WELD_DISTANCE, 400)] {
            let at = |index: u32| {
                let [turn, height] = [2.4 * f64::from(index), f64::from(index) / 10_000.0 - 1.0];
                let across = (1.0 - height * height).max(0.0).sqrt();
                Point3::new(turn.cos() * across, turn.sin() * across, height) * radius
            };
            let places = weld(&(0..20_000).map(at).collect::<Vec<_>>());
            let count = 1 + places.iter().max().unwrap();
            assert!((1..=most).contains(&count), "{count} places");
        }
    }

    #[test]
    fn triangles_with_two_corners_at_one_place_do_not_part_their_neighbours() {
        let opposite = opposite_sides(&[[0, 1, 2], [2, 1, 2], [1, 1, 2], [2, 1, 3]]);
        assert_eq!((opposite[1], opposite[9]), (9, 1));
        assert_eq!(opposite.iter().filter(|side| **side != NONE).count(), 2);
    }

    #[test]
    fn neighbours_are_the_vertices_of_common_sides_wherever_they_are_asked_for() {
        // Two triangles at a side, a third one at the same side, one that is wound the other way, and one by itself.
        let triangles = [[0, 1, 2], [2, 1, 3], [1, 2, 4], [3, 1, 5], [6, 8, 7]];
        let expected: [&[u32]; 9] = [
            &[1, 2],
            &[0, 2, 3, 4, 5],
            &[0, 1, 3, 4],
            &[1, 2, 5],
            &[1, 2],
            &[1, 3],
            &[7, 8],
            &[6, 8],
            &[6, 7],
        ];
        let all = Neighbours::of(&triangles, 9);
        for (vertex, expected) in expected.into_iter().enumerate() {
            assert_eq!(all.of_vertex(vertex), expected, "{vertex}");
        }
        let some = Neighbours::of_chosen(&triangles, &[1, 0, 0, 1, 0, 0, 0, 1, 0].map(|chosen| chosen == 1));
        for (vertex, expected) in expected.into_iter().enumerate() {
            let is_chosen = [0, 3, 7].contains(&vertex);
            assert_eq!(some.of_vertex(vertex), if is_chosen { expected } else { &[] }, "{vertex}");
        }
    }

    #[test]
    fn marks_spread_by_one_side_at_a_time() {
        let strip = [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]];
        for (sides, expected) in [(0, 1), (1, 3), (2, 5), (3, 6)] {
            let mut is_marked = [true, false, false, false, false, false];
            spread(&mut is_marked, &strip, sides);
            assert_eq!(is_marked, [0, 1, 2, 3, 4, 5].map(|vertex| vertex < expected), "{sides}");
        }
    }
}
