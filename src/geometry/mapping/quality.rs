//! Measures how well lengths, areas and angles are kept on the part: the quality results of every report.

use nalgebra::{Point3, Vector3};

use crate::geometry::height_field::Uncertainty;
use crate::geometry::ink::{Ink, Piece};
use crate::geometry::space::{FlatPoint, ViewPoint};

/// Maximum length of the pieces of lines for the quality results, mm.
pub const PIECE: f64 = 0.25;
/// Side of the squares of the inked area for the quality results, mm.
pub const SQUARE: f64 = 0.2;

/// The doubt about the slope is a mean over a facet; at some place it is this many times as large. Sums need the mean,
/// largest values the latter.
const PEAK: f64 = 3.0;

/// The differences between the drawing and its image on the part.
///
/// The sums are those of Chuang, Shape correction for laser marking, 2023, equations 5.1 and 5.2.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Distortion {
    /// e_l: sum over all pieces of the lines of |length on the part − length drawn|, mm.
    pub length_error: f64,
    /// e_a: sum over all squares of the inked area of |area on the part − area drawn|, mm².
    pub area_error: f64,
    /// Length of all lines as drawn, mm.
    pub length: f64,
    /// Inked area as drawn, mm².
    pub area: f64,
    /// Largest |length on the part / length drawn − 1| of a piece.
    pub max_stretch: f64,
    /// Its position in the drawing.
    pub max_stretch_at: FlatPoint,
    /// Smallest and largest length on the part / length drawn − 1 of a piece; both 0 without lines.
    pub stretch_range: [f64; 2],
    /// Root mean square of length on the part / length drawn − 1, weighted by length.
    pub rms_stretch: f64,
    /// Largest change of the angle between any two directions, over the inked squares and along the lines, rad.
    pub max_angle_error: f64,
    /// Largest |area on the part / area drawn − 1| of a square; 0 without inked area.
    pub max_area_stretch: f64,
    /// The share of the results that follows from what is not known about the slope of the part.
    pub uncertain: Uncertain,
}

/// The share of a [`Distortion`] that follows from what is not known about the slope of the part.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct Uncertain {
    /// Share of e_l, mm.
    pub length_error: f64,
    /// Share of e_a, mm².
    pub area_error: f64,
    /// Share of the largest stretch of a length.
    pub max_stretch: f64,
    /// Largest share of an angle error, rad.
    pub max_angle_error: f64,
    /// Largest possible error of the slope under the ink, rad.
    pub max_slope: f64,
    /// Largest possible error of the height under the ink, mm.
    pub max_height: f64,
}

/// Measures a map on a part. `ink` should be sampled with [`PIECE`] and [`SQUARE`]; `height` returns the height of
/// the part itself (mm), not of a fit to it, and `None` outside the part. Without ink every value is 0.
///
/// # Errors
/// The first point of the view for which `height` returns `None`.
pub fn measure(
    ink: &Ink,
    map: impl Fn(FlatPoint) -> ViewPoint,
    height: impl Fn(ViewPoint) -> Option<f64>,
) -> Result<Distortion, ViewPoint> {
    measure_at_most(ink, map, height, |_| Uncertainty::NONE)
}

/// The same where `doubt` states what is not known of the part between the vertices of its mesh: every result is an estimate from
/// above, and [`Distortion::uncertain`] is the share that the doubt adds.
///
/// If a line climbs at the angle θ, an error δ of that angle changes its length by the share δ·tan θ + δ²/2. Areas change
/// by the same share, with the angle between the surface and the view for θ; angles by as many radians.
///
/// # Errors
/// The first point of the view for which `height` returns `None`.
pub fn measure_at_most(
    ink: &Ink,
    map: impl Fn(FlatPoint) -> ViewPoint,
    height: impl Fn(ViewPoint) -> Option<f64>,
    doubt: impl Fn(ViewPoint) -> Uncertainty,
) -> Result<Distortion, ViewPoint> {
    let lift = |flat: FlatPoint| lift(flat, &map, &height);
    let mut distortion = Distortion {
        length_error: 0.0,
        area_error: 0.0,
        length: 0.0,
        area: ink.area(),
        max_stretch: 0.0,
        max_stretch_at: FlatPoint::new(0.0, 0.0),
        stretch_range: [0.0; 2],
        rms_stretch: 0.0,
        max_angle_error: 0.0,
        max_area_stretch: 0.0,
        uncertain: Uncertain::default(),
    };
    let mut range = None;
    for lifted in lifted(ink, lift) {
        let Lifted { piece, from, to } = lifted?;
        let drawn = piece.length();
        let stretch = (to - from).norm() / drawn - 1.0;
        let doubt = doubt(ViewPoint::from(nalgebra::center(&from, &to).coords.xy()));
        let along = to - from;
        let uncertain = (1.0 + stretch) * share(along.z.abs() / along.xy().norm(), doubt);
        let most = stretch.abs() + uncertain;
        let peak = PEAK * uncertain;
        widen(&mut range, stretch - peak);
        widen(&mut range, stretch + peak);
        distortion.length += drawn;
        let sideways = nalgebra::Vector2::new(piece.from.y - piece.to.y, piece.to.x - piece.from.x) / 2.0;
        let middle = piece.from.lerp(piece.to, 0.5);
        let beside = |step: nalgebra::Vector2<f64>| lift(middle + step);
        // A point beside the piece may be outside the part; then the angle is not measured.
        if let (Ok(left), Ok(right)) = (beside(sideways), beside(-sideways)) {
            distortion.include_angle([&along, &(left - right)], doubt);
        }
        distortion.length_error += most * drawn;
        distortion.uncertain.length_error += uncertain * drawn;
        distortion.rms_stretch += most * most * drawn;
        if stretch.abs() + peak > distortion.max_stretch {
            distortion.max_stretch = stretch.abs() + peak;
            distortion.max_stretch_at = piece.from.lerp(piece.to, 0.5);
            distortion.uncertain.max_stretch = peak;
        }
    }
    distortion.stretch_range = range.unwrap_or_default();
    if distortion.length > 0.0 {
        distortion.rms_stretch = (distortion.rms_stretch / distortion.length).sqrt();
    }
    let half = ink.side / 2.0;
    for square in &ink.squares {
        let corner = |x: f64, y: f64| lift(FlatPoint::new(square.x + x * half, square.y + y * half));
        let [a, b, c, d] = [corner(-1.0, -1.0)?, corner(1.0, -1.0)?, corner(1.0, 1.0)?, corner(-1.0, 1.0)?];
        let area = ((b - a).cross(&(c - a)).norm() + (c - a).cross(&(d - a)).norm()) / 2.0;
        let drawn = ink.side * ink.side;
        let across = (b - a) + (c - d);
        let up = (d - a) + (c - b);
        let doubt = doubt(ViewPoint::from(nalgebra::center(&a, &c).coords.xy()));
        let uncertain = area * share(tilt(&across, &up), doubt);
        let error = (area - drawn).abs();
        distortion.area_error += error + uncertain;
        distortion.uncertain.area_error += uncertain;
        distortion.max_area_stretch = distortion.max_area_stretch.max((error + PEAK * uncertain) / drawn);
        distortion.include_angle([&across, &up], doubt);
    }
    Ok(distortion)
}

impl Distortion {
    /// Includes the angle error where unit steps of the drawing become two vectors on the part, with a doubt about
    /// the part.
    fn include_angle(&mut self, [across, up]: [&Vector3<f64>; 2], doubt: Uncertainty) {
        let uncertain = PEAK * share(tilt(across, up), doubt);
        self.max_angle_error = self.max_angle_error.max(angle_error(across, up) + uncertain);
        self.uncertain.max_angle_error = self.uncertain.max_angle_error.max(uncertain);
        self.uncertain.max_slope = self.uncertain.max_slope.max(f64::from(doubt.slope));
        self.uncertain.max_height = self.uncertain.max_height.max(f64::from(doubt.height));
    }
}

/// The share by which a length changes where it climbs with the slope `tan`, if the angle of the slope is wrong by as
/// much as it may; 0 without a doubt.
fn share(tan: f64, doubt: Uncertainty) -> f64 {
    let slope = f64::from(doubt.slope);
    if slope > 0.0 { tan * slope + slope * slope / 2.0 } else { 0.0 }
}

/// The tangent of the angle between the laser's axis and the normal of a plane through two vectors.
fn tilt(across: &Vector3<f64>, up: &Vector3<f64>) -> f64 {
    let normal = across.cross(up);
    normal.xy().norm() / normal.z.abs()
}

/// Smallest and largest length on the part / length drawn − 1 of the pieces that are on the part; `None` if none is.
pub fn stretch_range(
    ink: &Ink,
    map: impl Fn(FlatPoint) -> ViewPoint,
    height: impl Fn(ViewPoint) -> Option<f64>,
) -> Option<[f64; 2]> {
    let mut range = None;
    for Lifted { piece, from, to } in lifted(ink, |flat| lift(flat, &map, &height)).flatten() {
        widen(&mut range, (to - from).norm() / piece.length() - 1.0);
    }
    range
}

fn widen(range: &mut Option<[f64; 2]>, stretch: f64) {
    let [min, max] = range.unwrap_or([stretch; 2]);
    *range = Some([min.min(stretch), max.max(stretch)]);
}

/// A piece of a line, and the images of its ends on the part.
struct Lifted {
    piece: Piece,
    from: Point3<f64>,
    to: Point3<f64>,
}

/// The pieces on the part; for a piece with an end outside the part, the position of that end in the view.
fn lifted(
    ink: &Ink,
    lift: impl Fn(FlatPoint) -> Result<Point3<f64>, ViewPoint>,
) -> impl Iterator<Item = Result<Lifted, ViewPoint>> {
    let mut last: Option<(FlatPoint, Point3<f64>)> = None;
    // `Ink` has public fields, so callers may add pieces without length.
    ink.pieces.iter().filter(|piece| piece.length() > 0.0).map(move |piece| {
        // Most pieces start where the last one ended.
        let from = match last {
            Some((flat, point)) if flat == piece.from => point,
            _ => lift(piece.from)?,
        };
        let to = lift(piece.to)?;
        last = Some((piece.to, to));
        Ok(Lifted { piece: *piece, from, to })
    })
}

/// The image of a point of the drawing on the part, or its position in the view if there is no surface.
fn lift(
    flat: FlatPoint,
    map: &impl Fn(FlatPoint) -> ViewPoint,
    height: &impl Fn(ViewPoint) -> Option<f64>,
) -> Result<Point3<f64>, ViewPoint> {
    let seen = map(flat);
    height(seen).map(|z| Point3::new(seen.x, seen.y, z)).ok_or(seen)
}

/// The largest change of the angle between any two directions, rad, where unit steps in s and t of the drawing become
/// the vectors `across` and `up` on the part: 2·asin((σ₁ − σ₂)/(σ₁ + σ₂)) for the principal stretches σ₁ ≥ σ₂.
///
/// Tissot's maximum angular distortion (Snyder, Map Projections: A Working Manual, 1987, eq. 4-1a).
fn angle_error(across: &Vector3<f64>, up: &Vector3<f64>) -> f64 {
    let (e, f, g) = (across.norm_squared(), across.dot(up), up.norm_squared());
    // (σ₁ ± σ₂)² = E + G ± 2√(EG − F²)
    let twice_area = 2.0 * (e * g - f * f).max(0.0).sqrt();
    let ratio = ((e + g - twice_area).max(0.0) / (e + g + twice_area)).sqrt();
    2.0 * ratio.clamp(0.0, 1.0).asin()
}
