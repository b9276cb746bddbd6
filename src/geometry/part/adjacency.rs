//! Which triangles, vertices and sides of a mesh are neighbours.

use nalgebra::{Point3, Vector3};

/// Positions closer together than this, mm, are treated as one vertex: exporters repeat vertices at face borders, and
/// the precision of a 32-bit float is 0.00002 mm on a part of 200 mm.
const WELD_DISTANCE: f64 = 1e-4;

/// The normal of a triangle whose smallest height is less than this, mm, is not reliable.
const SLIVER: f64 = 0.005;

/// Marks a missing index, such as that of a side or a vertex.
pub(crate) const NONE: u32 = u32::MAX;

/// For each position, the number of its place, from 0 in the order of first appearance; positions in one weld cell
/// share a place.
pub(crate) fn weld(positions: &[Point3<f64>]) -> Vec<u32> {
    numbered(positions.len(), |index| {
        positions[index].coords.map(|value| (value / WELD_DISTANCE).round() as i64).into()
    })
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
pub(super) fn hash(numbers: [u64; 3]) -> u64 {
    numbers
        .iter()
        .fold(0, |sum: u64, number| (sum.rotate_left(23) ^ number).wrapping_mul(0x9E37_79B9_7F4A_7C15))
}

/// For each side of each triangle (side 3·t + k runs from corner k to the next), the other side between the same two
/// vertices; [`NONE`] at a border and where more than two triangles meet.
pub(crate) fn opposite_sides(triangles: &[[u32; 3]]) -> Vec<u32> {
    let count = triangles.iter().flatten().max().map_or(0, |last| *last as usize + 1);
    let ends = |side: usize| {
        let (from, to) = (triangles[side / 3][side % 3], triangles[side / 3][(side + 1) % 3]);
        // (side + 1) % 3 is the next corner, because 3·t is a multiple of 3.
        (from.min(to), from.max(to))
    };
    let sides = triangles.len() * 3;
    let (starts, by_lower) = grouped(count, || (0..sides).map(|side| (ends(side).0, side as u32)));
    let mut opposite = vec![NONE; sides];
    let mut around: Vec<(u32, u32)> = Vec::new();
    for vertex in 0..count {
        let here = &by_lower[starts[vertex] as usize..starts[vertex + 1] as usize];
        around.clear();
        around.extend(here.iter().map(|&side| (ends(side as usize).1, side)));
        around.sort_unstable();
        for run in around.chunk_by(|a, b| a.0 == b.0) {
            if let [(upper, one), (_, two)] = *run
                && upper != vertex as u32
            {
                (opposite[one as usize], opposite[two as usize]) = (two, one);
            }
        }
    }
    opposite
}

/// Values by the group to which they belong, in the order in which `items` has them (group, value): where those of each of the
/// `count` groups begin, and at the end their number; and the values.
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

/// Marks the vertices that can be reached from the marked ones over so many sides.
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
