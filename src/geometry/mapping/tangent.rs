//! Directions on a surface, in the view.

use nalgebra::{Matrix2, Vector2};

/// The linear map from the drawing to the view that is isometric onto a tangent plane with this gradient and keeps
/// the x direction.
pub fn tangent_frame(gradient: &Vector2<f64>) -> Matrix2<f64> {
    let right = 1.0 / (1.0 + gradient.x * gradient.x).sqrt();
    let lift = (1.0 + gradient.norm_squared()).sqrt();
    // The unit vector of the tangent plane that is perpendicular to (right, 0) in the metric of the plane.
    let up = 1.0 / (right * lift);
    let across = -gradient.x * gradient.y / (1.0 + gradient.x * gradient.x) * up;
    Matrix2::new(right, across, 0.0, up)
}
