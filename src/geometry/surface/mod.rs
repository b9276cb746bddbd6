//! The part's surface: knots, NURBS, nearest points, the fit to a height field, and scans.

pub mod knots;
pub mod nurbs;
pub mod closest;
pub mod fit;
pub mod scan;
mod kinks;
mod summed_area;
