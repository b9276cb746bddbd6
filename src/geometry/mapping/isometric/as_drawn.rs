//! The drawing as it is, as a map, and what maps leave: no correction may be worse than none.

use nalgebra::Vector2;

use super::strain::{Sample, Strain};
use super::{Figure, Instead, IsometricMap, IsometricOptions, coarse_grid};
use crate::geometry::ink::{Ink, Piece};
use crate::geometry::space::FlatPoint;
use crate::geometry::surface::nurbs::NurbsSurface;

/// Differences of the mean strain of lines or areas below this do not matter: 0.01 mm in 100 mm.
const SAME_STRAIN: f64 = 1e-4;
/// Differences of the largest angle error below this do not matter, rad.
const SAME_ANGLE: f64 = 5e-3;
/// About this number of inked squares is compared.
const MOST_SQUARES: usize = 3000;

impl IsometricMap {
    /// The drawing as it is: every point keeps its place in the view.
    pub(crate) fn as_drawn(ink: &Ink, anchor: FlatPoint, options: &IsometricOptions) -> Self {
        let mut extents = ink.extents;
        extents.include(anchor.coords());
        let (knots_s, knots_t) = coarse_grid(&extents, options);
        let (columns, rows) = (knots_s.control_points(), knots_t.control_points());
        let place =
            |index: usize| Vector2::new(knots_s.greville(index % columns), knots_t.greville(index / columns));
        let control = (0..columns * rows).map(place).collect();
        let instead = Some(Instead::AsDrawn);
        Self { knots_s, knots_t, control, iterations: Vec::new(), settled: true, instead }
    }

    /// Whether another map leaves notably less of the figure that comes first; without one, no more of any figure and less of
    /// the lengths.
    pub(crate) fn is_worse_than(
        &self,
        other: &Self,
        surface: &NurbsSurface,
        ink: &Ink,
        first: Option<Figure>,
    ) -> bool {
        let gain = |figure: Figure| self.left(figure, surface, ink) - other.left(figure, surface, ink);
        match first {
            Some(Figure::Angles) => gain(Figure::Angles) > SAME_ANGLE,
            Some(figure) => gain(figure) > SAME_STRAIN,
            None => {
                gain(Figure::Lengths) > SAME_STRAIN
                    && gain(Figure::Areas) >= 0.0
                    && gain(Figure::Angles) >= 0.0
            }
        }
    }

    /// Whether the map leaves almost no error in any figure.
    pub(crate) fn is_true(&self, surface: &NurbsSurface, ink: &Ink) -> bool {
        let limits =
            [(Figure::Lengths, SAME_STRAIN), (Figure::Areas, SAME_STRAIN), (Figure::Angles, SAME_ANGLE)];
        limits.iter().all(|(figure, limit)| self.left(*figure, surface, ink) <= *limit)
    }

    /// What the map leaves of a figure: the mean absolute strain along lines or of areas, or the largest angle error, rad.
    pub(crate) fn left(&self, figure: Figure, surface: &NurbsSurface, ink: &Ink) -> f64 {
        let strain_at = |at: FlatPoint| {
            self.strain_only(surface, &Sample::at(self.knots_s.basis(at.x), self.knots_t.basis(at.y)))
        };
        let middle = |piece: &Piece| piece.from.lerp(piece.to, 0.5);
        let squares = || ink.squares.iter().step_by(ink.squares.len().div_ceil(MOST_SQUARES).max(1));
        let is_finite = |error: &f64| error.is_finite();
        match figure {
            Figure::Lengths => {
                let error = |piece: &Piece| {
                    let direction = (piece.to - piece.from) / piece.length();
                    piece.length() * strain_at(middle(piece)).along_direction(&direction).abs()
                };
                let length = ink.length().max(f64::MIN_POSITIVE);
                ink.pieces.iter().map(error).filter(is_finite).sum::<f64>() / length
            }
            Figure::Areas => {
                let error = |square: &FlatPoint| (strain_at(*square).area() - 1.0).abs();
                squares().map(error).filter(is_finite).sum::<f64>() / squares().count().max(1) as f64
            }
            Figure::Angles => {
                let places = ink.pieces.iter().map(middle).chain(squares().copied());
                places
                    .map(strain_at)
                    .map(|strain: Strain| strain.angle_error())
                    .filter(is_finite)
                    .fold(0.0, f64::max)
            }
        }
    }
}
