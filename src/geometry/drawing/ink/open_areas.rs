//! Areas inside outlines that nothing fills, where they are not completely on the part.

use super::{Ink, Inked};
use crate::geometry::space::FlatPoint;

impl Ink {
    /// The ink without some of its areas: those that are not in `marked` (the ink without the areas inside
    /// outlines that nothing fills) and that are only partly on the part. Returns a place of each that is not
    /// on the part. Only the outlines of these areas are ink: a dial round a shaft has no area. An area ends
    /// at its outlines and at `marked` areas.
    pub fn without_open_areas(
        self,
        marked: &Self,
        is_on_part: impl Fn(FlatPoint) -> bool,
    ) -> (Self, Vec<FlatPoint>) {
        if self.squares.is_empty() {
            return (self, Vec::new());
        }
        let grid = |squares: &[FlatPoint]| Inked::of(squares, &self.extents, self.side);
        let (mut inked, marked) = (grid(&self.squares), grid(&marked.squares));
        let mut enclosed: Vec<bool> =
            inked.squares.iter().zip(&marked.squares).map(|(inked, marked)| *inked && !marked).collect();
        let columns = inked.columns;
        let mut places = Vec::new();
        for start in 0..enclosed.len() {
            let mut area = Vec::new();
            let mut open = vec![start];
            while let Some(square) = open.pop() {
                if !std::mem::take(&mut enclosed[square]) {
                    continue;
                }
                area.push(square);
                let beside = [
                    (square % columns > 0).then(|| square - 1),
                    (square % columns + 1 < columns).then_some(square + 1),
                    square.checked_sub(columns),
                    Some(square + columns).filter(|above| *above < enclosed.len()),
                ];
                open.extend(beside.into_iter().flatten().filter(|square| enclosed[*square]));
            }
            let center = |square: usize| inked.center(square % columns, square / columns);
            if let Some(beside) = area.iter().map(|square| center(*square)).find(|at| !is_on_part(*at)) {
                places.push(beside);
                area.iter().for_each(|square| inked.squares[*square] = false);
            }
        }
        if places.is_empty() {
            return (self, places);
        }
        let squares = inked.centers();
        let inked_area = self.inked_area * squares.len() as f64 / self.squares.len() as f64;
        (Self { squares, blocks: inked.into_blocks(), inked_area, ..self }, places)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::Vector2;

    use super::*;
    use crate::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};

    fn circle(x: f64, radius: f64, region: Option<u32>) -> Path {
        let arc = Segment::Arc {
            center: FlatPoint::new(x, 0.0),
            u: Vector2::new(radius, 0.0),
            v: Vector2::new(0.0, radius),
            start: 0.0,
            sweep: 2.0 * PI,
        };
        let shape = Shape::Closed(vec![arc]);
        Path { layer: 0, color: Color::ByLayer, shape, region, source: Source::default() }
    }

    #[test]
    fn only_open_areas_beside_the_part_are_left_out() {
        let hole = |at: FlatPoint| at.coords().norm() > 4.0;
        // A ring round the hole with a label beside it; a filled disc; two rings with surface between them; a ring with a filled
        // disc in the hole.
        let cases: [(Vec<Path>, f64, usize); 4] = [
            (vec![circle(0.0, 10.0, None), circle(20.0, 3.0, None)], 9.0 * PI, 1),
            (vec![circle(0.0, 10.0, Some(1)), circle(20.0, 3.0, None)], 109.0 * PI, 0),
            (vec![circle(0.0, 10.0, None), circle(0.0, 5.0, None)], 75.0 * PI, 0),
            (vec![circle(0.0, 10.0, None), circle(0.0, 3.0, Some(1))], 9.0 * PI, 1),
        ];
        for (number, (paths, area, places)) in cases.into_iter().enumerate() {
            let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
            let pattern = Pattern { layers, paths };
            let [ink, marked] = [Ink::sample, Ink::sample_as_marked]
                .map(|sample| sample(&pattern, |_: &str| true, 0.25, 0.1));
            let length = ink.length();
            let (ink, found) = ink.without_open_areas(&marked, hole);
            assert_eq!(found.len(), places, "{number}");
            assert!(found.iter().all(|at| !hole(*at)), "{number}");
            assert_eq!(ink.length(), length);
            assert!((ink.area() / area - 1.0).abs() < 0.01, "{number}: {} of {area}", ink.area());
            let in_blocks: usize = ink.blocks.iter().map(|block| block.squares()).sum();
            assert_eq!(in_blocks, ink.squares.len(), "{number}");
        }
    }
}
